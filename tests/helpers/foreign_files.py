"""Pictures and movies as other programs write them, with what their containers say, made here."""

import functools
import io
import struct
import zlib
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import av
import numpy as np
import OpenImageIO as oiio
from av.filter import Graph
from PIL import Image

BT2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
RED_OF_BT2020 = (1.6605, -0.1246, -0.0182)  # in Rec.709
ADOBE_GREEN = (-0.1753, 0.5859, -0.0248)  # 60 200 0 of Adobe RGB, in Rec.709


def ramp(height=64, width=64, dtype=np.uint8):
    """Colours (H, W, 3) of many values, soft enough for lossy codecs."""
    y, x = np.mgrid[:height, :width] / (max(height, width) - 1)
    full = np.iinfo(dtype).max
    return np.rint(full * np.stack([0.1 + 0.6 * x, 0.1 + 0.6 * y, 0.5 - 0.3 * x], -1)).astype(dtype)


def disc(size=64):
    """A matte (H, W) uint8: 255 in the middle, 0 outside."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    return np.where(np.hypot(x, y) < size / 3, 255, 0).astype(np.uint8)


def decode_srgb(codes):
    codes = np.asarray(codes, float)
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


# Pictures


def png(path, codes, **chunks):
    """A PNG of (H, W, 3) uint8 or big-endian uint16 with chunks before its pixels."""
    codes = np.ascontiguousarray(codes)
    depth = 8 * codes.itemsize
    rows = b"".join(b"\0" + row.astype(f">u{codes.itemsize}").tobytes() for row in codes)
    parts = {"IHDR": struct.pack(">IIBBBBB", codes.shape[1], codes.shape[0], depth, 2, 0, 0, 0)}
    parts |= chunks | {"IDAT": zlib.compress(rows), "IEND": b""}
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in parts.items():
        kind = name.encode()
        content += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    path.write_bytes(content)


def chromaticity_chunk(chromaticities):
    """The content of cHRM."""
    values = (*chromaticities[6:], *chromaticities[:6])
    return struct.pack(">8I", *(round(value * 100000) for value in values))


def bmp(
    path, codes, *, compression=0, alpha_mask=0, header=40, colour=b"", masks=(0xFF0000, 0xFF00, 0xFF)
):  # fmt: skip
    """A BMP of 32 bits a pixel, of (H, W, 4) uint8; `colour` is what a header of version 4 or 5 says."""
    height, width = codes.shape[:2]
    pixels = codes[::-1, :, [2, 1, 0, 3]].tobytes()
    masks = struct.pack("<4I", *masks, alpha_mask)
    fields = struct.pack("<IiiHHIIiiII", header, width, height, 1, 32, compression, len(pixels), 0, 0, 0, 0)
    head = (fields + (masks + colour if header > 40 else b"")).ljust(header, b"\0")
    if header == 40 and compression:  # the masks follow the header
        head += masks[: 16 if compression == 6 else 12]
    start = 14 + len(head)
    path.write_bytes(b"BM" + struct.pack("<IHHI", start + len(pixels), 0, 0, start) + head + pixels)


def radiance(path, pixel, *lines, size=(8, 16), kind="32-bit_rle_rgbe"):
    """A Radiance picture of one RGBE pixel repeated; `lines` go into its header."""
    head = "\n".join(["#?RADIANCE", *lines, f"FORMAT={kind}", "", f"-Y {size[0]} +X {size[1]}", ""])
    path.write_bytes(head.encode() + bytes(pixel) * (size[0] * size[1]))


def parts(path, *specs):
    """An OpenEXR file of several parts: (name, channels, (H, W, C) array, {attribute: value}) each."""
    made = []
    for name, channels, pixels, attributes in specs:
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], "half")
        spec.channelnames = tuple(channels)
        spec.attribute("oiio:subimagename", name)
        for key, value in attributes.items():
            spec.attribute(key, value)
        made.append(spec)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), tuple(made))
    for number, (_, _, pixels, _) in enumerate(specs):
        if number:
            assert file.open(str(path), made[number], "AppendSubimage")
        assert file.write_image(np.ascontiguousarray(pixels, np.float32))
    file.close()


def unsigned_exr(path, **channels):
    """An OpenEXR file of UINT channels, (H, W) each, uncompressed: OpenImageIO writes none."""
    height, width = next(iter(channels.values())).shape
    names = sorted(channels)
    described = b"".join(name.encode() + struct.pack("<xIB3xII", 0, 0, 1, 1) for name in names) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = {
        "channels": ("chlist", described),
        "compression": ("compression", b"\0"),
        "dataWindow": ("box2i", box),
        "displayWindow": ("box2i", box),
        "lineOrder": ("lineOrder", b"\0"),
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", bytes(8)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
    }
    content = struct.pack("<II", 20000630, 2)
    for name, (kind, value) in header.items():
        content += f"{name}\0{kind}\0".encode() + struct.pack("<I", len(value)) + value
    content += b"\0"
    rows = [
        struct.pack("<iI", y, 4 * width * len(names))
        + b"".join(channels[name][y].astype("<u4").tobytes() for name in names)
        for y in range(height)
    ]
    first = len(content) + 8 * height
    starts = [first + sum(map(len, rows[:y])) for y in range(height)]
    path.write_bytes(content + struct.pack(f"<{height}Q", *starts) + b"".join(rows))


def exif(**tags):
    """Exif data: ColorSpace, Gamma in Exif's own directory, InteroperabilityIndex, others in the first."""
    found = Image.Exif()
    details = found.get_ifd(0x8769)
    for name, value in tags.items():
        if name == "ColorSpace":
            details[0xA001] = value
        elif name == "Gamma":
            details[0xA500] = value
        elif name == "InteroperabilityIndex":
            details[0xA005] = {1: value}
        else:
            found[{"Orientation": 0x112, "WhitePoint": 0x13E, "PrimaryChromaticities": 0x13F}[name]] = value
    return found.tobytes()


def with_segments(content, *segments):
    """A JPEG with further segments, (marker, data) each, at its start."""
    added = b"".join(struct.pack(">BBH", 255, marker, len(data) + 2) + data for marker, data in segments)
    return content[:2] + added + content[2:]


def gain_map_jpeg(path, codes, gain, *, icc_profile=None):
    """A JPEG (H, W, 3) with a gain map (H, W), as Android's Ultra HDR is stored: XMP and CIPA DC-007."""

    def jpeg(array, **options):
        file = io.BytesIO()
        Image.fromarray(array).save(file, "JPEG", quality=97, subsampling=0, **options)
        return file.getvalue()

    def xmp(attributes, inner=""):
        text = (
            '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
            'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
            'xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" '
            'xmlns:Container="http://ns.google.com/photos/1.0/container/" '
            'xmlns:Item="http://ns.google.com/photos/1.0/container/item/" '
            f"{attributes}>{inner}</rdf:Description></rdf:RDF></x:xmpmeta>"
        )
        return 0xE1, b"http://ns.adobe.com/xap/1.0/\0" + text.encode()

    def index(sizes, offset):
        entries = b"".join(
            struct.pack(">IIIHH", kind, size, start, 0, 0)
            for kind, size, start in ((0x030000, sizes[0], 0), (0, sizes[1], offset))
        )
        directory = struct.pack(">HHI4s", 0xB000, 7, 4, b"0100") + struct.pack(">HHII", 0xB001, 4, 1, 2)
        directory += struct.pack(">HHIII", 0xB002, 7, len(entries), 50, 0)
        return 0xE2, b"MPF\0MM\0*" + struct.pack(">IH", 8, 3) + directory + entries

    settings = {"GainMapMin": 0, "GainMapMax": 2, "Gamma": 1, "OffsetSDR": 0.015625, "OffsetHDR": 0.015625}
    settings |= {"HDRCapacityMin": 0, "HDRCapacityMax": 2, "BaseRenditionIsHDR": "False"}
    about = " ".join(f'hdrgm:{name}="{value}"' for name, value in settings.items())
    second = with_segments(jpeg(gain), xmp(f'hdrgm:Version="1.0" {about}'))
    items = "".join(
        '<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="image/jpeg" '
        f'Item:Semantic="{kind}"{length}/></rdf:li>'
        for kind, length in (("Primary", ""), ("GainMap", f' Item:Length="{len(second)}"'))
    )
    directory = f"<Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>"
    options = {} if icc_profile is None else {"icc_profile": icc_profile}
    base, described = jpeg(codes, **options), xmp('hdrgm:Version="1.0"', directory)
    size = len(with_segments(base, described, index((0, 0), 0)))
    offset = size - 2 - (4 + len(described[1])) - 4 - 4  # from the byte order mark of the index
    first = with_segments(base, described, index((size, len(second)), offset))
    path.write_bytes(first + second)


def avif(path, codes, layout, primaries, transfer, matrix):
    """An AVIF of (H, W, 3) uint16 code values whose colour is said by H.273's numbers."""
    movie(
        path, [codes], codec="libsvtav1", layout=layout, container="avif", range_=2,
        colour=(primaries, transfer, matrix), options={"crf": "4", "preset": "8"},
    )  # fmt: skip


# Movies


def in_its_own_thread(function):
    """Run a function in a thread that ends with it.

    SVT-AV1 gives the calling thread real-time priority where the user is root. Child processes inherit it, so
    a later test could starve its own.
    """

    @functools.wraps(function)
    def run(*given, **settings):
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(function, *given, **settings).result()

    return run


@in_its_own_thread
def movie(
    path, frames, *, codec, layout, container=None, range_=1, colour=(1, 1, 1), aspect=None, field=None,
    options=None,
):  # fmt: skip
    """A movie of frames (H, W), (H, W, 3) or (H, W, 4), uint8 or uint16.

    range_: 1 limited, 2 full. colour: H.273's primaries, transfer function and matrix. aspect: of a pixel.
    field: "tff" or "bff" where two fields make a frame.
    """
    first = np.asarray(frames[0])
    formats = {(2, 1): "gray", (3, 1): "rgb24", (4, 1): "rgba", (3, 2): "rgb48le", (4, 2): "rgba64le"}
    given = formats[first.shape[2] if first.ndim == 3 else 2, first.itemsize]
    order = {"tff": "tt", "bff": "bb"}.get(field)
    options = dict(options or {}) | ({"flags": "+ildct+ilme", "field_order": order} if field else {})
    with av.open(str(path), "w", format=container) as file:
        stream = file.add_stream(codec, 25, options=options)
        stream.height, stream.width, stream.pix_fmt = first.shape[0], first.shape[1], layout
        context = stream.codec_context
        context.color_primaries, context.color_trc, context.colorspace = colour
        context.color_range = range_
        if aspect is not None:
            context.sample_aspect_ratio = Fraction(aspect)
        graph = None
        for number, codes in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(codes), format=given)
            if given != layout:
                frame = frame.reformat(
                    format=layout, src_color_range=2, dst_color_range=range_, dst_colorspace=colour[2]
                )
            frame.pts, frame.time_base = number, Fraction(1, 25)
            if field is not None:
                graph = graph or fields(frame, field)
                graph.push(frame)
                frame = graph.pull()
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def fields(frame, order):
    """A filter graph that says that a frame is of two fields."""
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    chain = [source, graph.add("setfield", order), graph.add("buffersink")]
    chain[0].link_to(chain[1])
    chain[1].link_to(chain[2])
    graph.configure()
    return graph
