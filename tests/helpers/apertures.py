"""Clean apertures (`clap`) put into movies and HEIF files that were written without one."""

import struct

VISUAL_SAMPLE = 78  # bytes of a video sample entry before its boxes (ISO/IEC 14496-12)


def aperture(width, height, right, below):
    """A box `clap`: its size, and how far its middle lies from the picture's."""
    return struct.pack(">I4s8i", 40, b"clap", width, 1, height, 1, right, 1, below, 1)


def _boxes(data, start, stop):
    while start + 8 <= stop:
        size, kind = struct.unpack_from(">I4s", data, start)
        yield start, size, kind
        start += size


def _find(data, start, stop, wanted):
    return next((at, size) for at, size, kind in _boxes(data, start, stop) if kind == wanted)


def _grow(data, at, count):
    struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + count)


def clip_movie(path, box):
    """Put a box into the first video track of a .mov or .mp4 whose samples come before its header."""
    data = bytearray(path.read_bytes())
    inside, start, stop = [], 0, len(data)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd"):
        at, size = _find(data, start, stop, name)
        inside.append(at)
        start, stop = at + 8, at + size
    entry, size, _ = next(_boxes(data, start + 8, stop))
    assert data.find(b"mdat") < inside[0]  # or offsets of samples would be wrong
    for at in (*inside, entry):
        _grow(data, at, len(box))
    data[entry + size : entry + size] = box
    path.write_bytes(data)


def clip_heif(path, box):
    """Put a box among the properties of the first item of an AVIF or HEIC, before its rotation."""
    data = bytearray(path.read_bytes())
    meta, meta_size = _find(data, 0, len(data), b"meta")
    iprp, iprp_size = _find(data, meta + 12, meta + meta_size, b"iprp")
    ipco, ipco_size = _find(data, iprp + 8, iprp + iprp_size, b"ipco")
    ipma, _ = _find(data, iprp + 8, iprp + iprp_size, b"ipma")
    kinds = [kind for _, _, kind in _boxes(data, ipco + 8, ipco + ipco_size)]
    count, first = data[ipma + 18], ipma + 19  # of the first item's properties
    order = [index & 0x7F for index in data[first : first + count]]
    place = next((at for at, i in enumerate(order) if kinds[i - 1] in (b"irot", b"imir")), count)
    data[ipma + 18] += 1
    data[first + place : first + place] = bytes([0x80 | (len(kinds) + 1)])
    data[ipco + ipco_size : ipco + ipco_size] = box
    added = len(box) + 1
    _grow(data, ipco, len(box))
    _grow(data, ipma + len(box), 1)
    _grow(data, iprp, added)
    _grow(data, meta, added)
    iloc, _ = _find(data, meta + 12, meta + meta_size + added, b"iloc")
    at = iloc + 16
    for _ in range(struct.unpack_from(">H", data, iloc + 14)[0]):
        at += (6 if data[iloc + 8] else 4) + (data[iloc + 13] >> 4)  # with the size of a base offset
        (extents,) = struct.unpack_from(">H", data, at)
        at += 2
        for _ in range(extents):
            _grow(data, at, added)
            at += 8
    path.write_bytes(data)
