"""XMP, in which photographs carry their rating and keywords."""

import struct
import zlib
from pathlib import Path
from xml.sax.saxutils import escape

import OpenImageIO as oiio

from relight.media.images.containers.headers import PNG_SIGNATURE

TIFF_TAG = 700  # XMLPacket, "XMP Specification Part 3", 1.1.5
PNG_KEYWORD = b"XML:com.adobe.xmp"  # of the iTXt chunk, "XMP Specification Part 3", 1.1.5


def packet(spec: oiio.ImageSpec) -> bytes:
    """Return the rating and the keywords of a photograph as XMP; nothing without them."""
    rating, keywords = spec.getattribute("IPTC:Rating"), spec.getattribute("Keywords")
    words = [word.strip() for word in str(keywords or "").split(";") if word.strip()]
    about = "" if rating is None else f"<xmp:Rating>{escape(str(rating))}</xmp:Rating>"
    if words:
        items = "".join(f"<rdf:li>{escape(word)}</rdf:li>" for word in words)
        about += f"<dc:subject><rdf:Bag>{items}</rdf:Bag></dc:subject>"
    if not about:
        return b""
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        'xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmlns:dc="http://purl.org/dc/elements/1.1/">'
        f'{about}</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    ).encode()


def add_to_png(path: Path, xmp: bytes) -> None:
    """Add XMP to a PNG in front of its pixels, where readers look: text, uncompressed, without language."""
    with path.open("r+b") as file:
        offset = len(PNG_SIGNATURE)
        while True:
            file.seek(offset)
            (length,), kind = struct.unpack(">I", file.read(4)), file.read(4)
            if kind == b"IDAT":
                break
            offset += length + 12  # with length, kind and checksum
        file.seek(offset)
        pixels = file.read()
        text = b"iTXt" + PNG_KEYWORD + bytes(5) + xmp
        file.seek(offset)
        file.write(struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text)) + pixels)
