"""Texts of options that begin with the name of a file: `studio.exr,rotation=90`."""

from pathlib import Path

QUOTE = '"'


def split_file_and_settings(text: str) -> tuple[str, list[str]]:
    """Return the name of the file that an option's text begins with, and the settings behind it.

    A comma ends the name, unless what follows it is no setting, `NAME=VALUE`. A name that holds such a comma
    is the longest beginning of the text that is a file, or stands in double quotes:
    `"studio, f=2.8.exr",rotation=90`. Raises ValueError where the quotes do not end before a comma.

    >>> split_file_and_settings("studio.exr,rotation=90,intensity=2")
    ('studio.exr', ['rotation=90', 'intensity=2'])
    >>> split_file_and_settings('"a,b=1.exr",rotation=90')
    ('a,b=1.exr', ['rotation=90'])
    """
    if text.startswith(QUOTE) and not _is_file(text):
        name, quote, rest = text[1:].partition(QUOTE)
        if not quote or rest[:1] not in ("", ","):
            raise ValueError(f'expected "NAME",settings, got {text!r}')
        return name, rest[1:].split(",") if rest[1:] else []
    words = text.split(",")
    for count in range(len(words), 0, -1):
        name, settings = ",".join(words[:count]), words[count:]
        if all("=" in word for word in settings) and _is_file(name):
            return name, settings
    count = next((count for count, word in enumerate(words) if count and "=" in word), len(words))
    return ",".join(words[:count]), words[count:]


def _is_file(name: str) -> bool:
    try:
        return Path(name).is_file()
    except (OSError, ValueError):  # too long, or with characters that no file has
        return False
