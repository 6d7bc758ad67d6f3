"""A small executor of ComfyUI workflows in API format, and stand-ins for the nodes of ComfyUI that they use.

It checks a workflow against the nodes' INPUT_TYPES as ComfyUI does before it runs: required inputs, types of
links, options and ranges. The stand-ins do what ComfyUI's nodes of these names do (nodes.py, nodes_mask.py).
"""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from helpers import ROOT
from relight.comfyui import NODE_CLASS_MAPPINGS

WORKFLOWS = ROOT / "examples" / "comfyui"


def run(workflow, folder, **changes):
    """Run a workflow, {number: {"class_type": ..., "inputs": ...}} or its file.

    `changes`: {"class_type": {input: value}} for all nodes of a class. Pictures are loaded from `folder`.
    Returns {number: what the node returned}; SaveImage returns its 8-bit codes (B, H, W, 3).
    """
    graph = json.loads(Path(workflow).read_text()) if isinstance(workflow, str | Path) else workflow
    classes = NODE_CLASS_MAPPINGS | stand_ins(folder)
    for node in graph.values():
        node["inputs"] |= changes.get(node["class_type"], {})
        check(node, graph, classes)
    results = {}

    def result(number):
        if number not in results:
            node = graph[number]
            inputs = {
                name: result(value[0])[value[1]] if linked(value) else value
                for name, value in node["inputs"].items()
            }
            kind = classes[node["class_type"]]
            returned = getattr(kind(), kind.FUNCTION)(**inputs)
            results[number] = returned["result"] if isinstance(returned, dict) else returned
        return results[number]

    for number in graph:
        result(number)
    return results


def linked(value):
    return isinstance(value, list)


def check(node, graph, classes):
    """Assert what ComfyUI's validation asks of a node."""
    described = classes[node["class_type"]].INPUT_TYPES()
    known = described.get("required", {}) | described.get("optional", {})
    assert set(described.get("required", {})) <= set(node["inputs"]) <= set(known), node
    for name, value in node["inputs"].items():
        kind, options = (*known[name], {})[:2]
        if linked(value):
            source = classes[graph[value[0]]["class_type"]]
            assert source.RETURN_TYPES[value[1]] == kind, (node, name)
        elif isinstance(kind, list):
            assert value in kind, (node, name)
        else:
            assert isinstance(value, {"STRING": str, "INT": int, "FLOAT": int | float}[kind]), (node, name)
            assert kind == "STRING" or options.get("min", value) <= value <= options.get("max", value)


def load_image(path):
    """IMAGE and MASK of a file as ComfyUI's Load Image gives them: the mask is one minus the alpha."""
    pixels = np.asarray(Image.open(path).convert("RGBA"), np.float32) / 255
    return torch.from_numpy(pixels[None, ..., :3]), torch.from_numpy(1 - pixels[None, ..., 3])


def codes_of(images):
    """The 8-bit codes that ComfyUI's Save Image writes, which cuts off the fraction."""
    return np.clip(255.0 * images.numpy(), 0, 255).astype(np.uint8)


def node(function, returns, optional=None, **required):
    """A node class that calls a function."""

    class Node:
        RETURN_TYPES = returns
        FUNCTION = "call"

        @classmethod
        def INPUT_TYPES(cls):
            return {"required": required, "optional": optional or {}}

        def call(self, **inputs):
            return function(**inputs)

    return Node


def stand_ins(folder):
    """The nodes of ComfyUI that the example workflows use, by class."""
    size = {"width": ("INT",), "height": ("INT",)}
    place = {"x": ("INT",), "y": ("INT",)}

    def empty_image(width, height, batch_size, color):
        channels = [(color >> shift & 255) / 255 for shift in (16, 8, 0)]
        return (torch.tensor(channels).expand(batch_size, height, width, 3).clone(),)

    def composite(destination, source, x, y, resize_source, mask=None):
        result = destination.clone()
        part = result[:, y : y + source.shape[1], x : x + source.shape[2]]
        shares = 1.0 if mask is None else mask[..., None]
        part[:] = shares * source + (1 - shares) * part
        return (result,)

    def crop(width, height, x, y, image=None, mask=None):
        pixels = image if mask is None else mask
        return (pixels[:, y : y + height, x : x + width],)

    def mask_composite(destination, source, x, y, operation):
        assert operation == "multiply"
        result = destination.clone()
        result[:, y : y + source.shape[1], x : x + source.shape[2]] *= source
        return (result,)

    def feather(mask, left, top, right, bottom):
        result = mask.clone()
        for x in range(left):
            result[:, :, x] *= (x + 1) / left
        for x in range(right):
            result[:, :, -x] *= (x + 1) / right
        for y in range(top):
            result[:, y] *= (y + 1) / top
        for y in range(bottom):
            result[:, -y] *= (y + 1) / bottom
        return (result,)

    return {
        "LoadImage": node(
            lambda image: load_image(Path(folder) / image), ("IMAGE", "MASK"), image=("STRING",)
        ),
        "SaveImage": node(
            lambda images, filename_prefix: (codes_of(images),),
            (),
            images=("IMAGE",),
            filename_prefix=("STRING",),
        ),
        "PreviewImage": node(lambda images: (), (), images=("IMAGE",)),
        "EmptyImage": node(empty_image, ("IMAGE",), **size, batch_size=("INT",), color=("INT",)),
        "ImageCrop": node(crop, ("IMAGE",), image=("IMAGE",), **size, **place),
        "CropMask": node(crop, ("MASK",), mask=("MASK",), **size, **place),
        "SolidMask": node(
            lambda value, width, height: (torch.full((1, height, width), value),),
            ("MASK",),
            **size,
            value=("FLOAT",),
        ),
        "FeatherMask": node(
            feather, ("MASK",), mask=("MASK",), **dict.fromkeys(("left", "top", "right", "bottom"), ("INT",))
        ),
        "MaskComposite": node(
            mask_composite,
            ("MASK",),
            destination=("MASK",),
            source=("MASK",),
            operation=(["multiply"],),
            **place,
        ),
        "ImageCompositeMasked": node(
            composite,
            ("IMAGE",),
            destination=("IMAGE",),
            source=("IMAGE",),
            optional={"mask": ("MASK",)},
            resize_source=([False],),
            **place,
        ),
        "CreateVideo": node(
            lambda images, fps: ((images, fps),), ("VIDEO",), images=("IMAGE",), fps=("FLOAT",)
        ),
        "SaveVideo": node(
            lambda video, **where: video,
            (),
            video=("VIDEO",),
            **dict.fromkeys(("filename_prefix", "format", "codec"), ("STRING",)),
        ),
    }
