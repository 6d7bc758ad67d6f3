"""What no output, page or cache carries on from its source: places, owners, serial numbers, folders.

One rule for the tags of movies, the headers of pictures and what a cache keeps of both.
"""

import re

# Words of a tag's name, in any container's spelling: `location-eng`, `Exif:BodySerialNumber`, `©xyz`
PRIVATE_NAME = re.compile(
    r"gps|geo(?!m)|locat|latitude|longitude|altitude|iso6709|\bxyz\b|\bloci\b|sublocation|\bcity\b|country"
    r"|province|owner|serial|camera_?uuid|(?:host|computer|machine|user)_?name|hostcomputer",
    re.IGNORECASE,
)
COORDINATES = re.compile(r"[+-]\d{1,3}\.\d+[+-]\d{1,3}\.\d+")  # ISO 6709
FOLDER = re.compile(
    r"(?:^|[\s\"'=(,;:\[<|])(?:/[^/\s]+/|~\w*/|[A-Za-z]:[\\/]|\\\\[^\\\s]+\\)|(?:file|smb|nfs|afp|sftp)://",
    re.IGNORECASE,
)


def is_private(name: str, value: object = None) -> bool:
    """Return whether a tag of this name and value stays out of what is made from its file.

    >>> is_private("com.apple.quicktime.location.ISO6709"), is_private("Exif:BodySerialNumber")
    (True, True)
    >>> is_private("comment", "from /home/jane/plates"), is_private("Exif:FNumber", 2.8)
    (True, False)
    """
    texts = [
        part for part in (value if isinstance(value, tuple | list) else (value,)) if isinstance(part, str)
    ]
    return bool(PRIVATE_NAME.search(name)) or any(
        COORDINATES.search(text) or FOLDER.search(text) for text in texts
    )
