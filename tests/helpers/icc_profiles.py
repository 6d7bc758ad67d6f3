"""ICC profiles made byte by byte."""

import struct

import colour
import numpy as np

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
    return _profile(tags, kind)


def _profile(tags, kind, intent=0):
    white = colour.xy_to_XYZ(D50)
    directory, data, start = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for name, content in tags.items():
        directory += struct.pack(">4sII", name, start + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    header = struct.pack(
        ">I4sI4s4s4s12x4s24xI3i", start + len(data), b"none", 0x04400000, b"mntr", kind, b"XYZ ", b"acsp",
        intent, *(round(value * 65536) for value in white),
    )  # fmt: skip
    return header.ljust(128, b"\0") + directory + data


def table_profile(tag, *, columns=(0, 1, 2), cicp=None, intent=0):
    """A profile with a table of sRGB's curve and primaries, `lut16Type` to CIE XYZ (ICC.1:2022, 10.10).

    `columns`: sRGB's primaries beside it, in this order; None for no curves and primaries. `cicp`: code
    points.
    """
    srgb = colour.RGB_COLOURSPACES["sRGB"]
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(srgb.whitepoint), colour.xy_to_XYZ(D50), transform="Bradford"
    )
    primaries = (adapted @ srgb.matrix_RGB_to_XYZ).T
    curve = np.rint(colour.models.eotf_sRGB(np.linspace(0, 1, 1024)) * 65535).astype(">u2").tobytes() * 3
    grid = np.rint([np.array(corner) @ primaries * 32768 for corner in np.ndindex(2, 2, 2)]).astype(">u2")
    straight = np.array([0, 65535], ">u2").tobytes() * 3
    matrix = struct.pack(">9i", *(65536 * (row == column) for row in range(3) for column in range(3)))
    table = b"mft2" + bytes(4) + bytes((3, 3, 2, 0)) + matrix + struct.pack(">HH", 1024, 2)
    tags = {b"desc": text("table"), b"cprt": text("none"), b"wtpt": vector(colour.xy_to_XYZ(D50))}
    if columns is not None:
        names = (b"rXYZ", b"gXYZ", b"bXYZ")
        tags |= {name: vector(primaries[at]) for name, at in zip(names, columns, strict=True)}
        tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), SRGB)
    tags[tag] = table + curve + grid.tobytes() + straight
    if cicp is not None:
        tags[b"cicp"] = b"cicp" + bytes(4) + bytes(cicp)
    return _profile(tags, b"RGB ", intent)
