"""ICC profiles made byte by byte."""

import struct

import colour

D50 = (0.3457, 0.3585)


def text(words):
    data = words.encode("utf-16-be")
    return struct.pack(">4s4xII2s2sII", b"mluc", 1, 12, b"en", b"US", len(data), 28) + data


def vector(xyz):
    return struct.pack(">4s4x3i", b"XYZ ", *(round(value * 65536) for value in xyz))


SRGB = struct.pack(  # parametric curve of type 3: (a x + b)^g from d, c x below (ICC.1:2022, 10.18)
    ">4s4xH2x5i", b"para", 3, *(round(v * 65536) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
)


def icc_profile(description, curve, space="sRGB", kind=b"RGB "):
    """A display profile of version 4 with the curve in every channel and the primaries of a colour space."""
    primaries = colour.RGB_COLOURSPACES[space]
    white = colour.xy_to_XYZ(D50)
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(primaries.whitepoint), white, transform="Bradford"
    )
    tags = {b"desc": text(description), b"cprt": text("none"), b"wtpt": vector(white)}
    if kind == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        columns = (adapted @ primaries.matrix_RGB_to_XYZ).T
        tags |= {name: vector(xyz) for name, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True)}
        tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve)
    directory, data, start = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for name, content in tags.items():
        directory += struct.pack(">4sII", name, start + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    header = struct.pack(
        ">I4sI4s4s4s12x4s28x3i", start + len(data), b"none", 0x04400000, b"mntr", kind, b"XYZ ", b"acsp",
        *(round(value * 65536) for value in white),
    )  # fmt: skip
    return header.ljust(128, b"\0") + directory + data
