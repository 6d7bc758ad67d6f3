"""Write the workflows of this folder in the format of ComfyUI's interface, with a place for each node.

python examples/comfyui/interface.py     # writes relight/comfyui/example_workflows, which ComfyUI offers
"""

import json
from pathlib import Path
from typing import Any

from relight.comfyui import NODE_CLASS_MAPPINGS

HERE = Path(__file__).parent
OFFERED = HERE.parents[1] / "relight" / "comfyui" / "example_workflows"
WIDGETS = ("INT", "FLOAT", "STRING", "BOOLEAN", "COMBO")
COLUMN, WIDTH, GAP = 400, 320, 70  # pixels of the canvas
TITLE, SLOT, WIDGET = 30, 22, 26  # heights
SHOWS = {"LoadImage": 330, "SaveImage": 270, "PreviewImage": 270, "SaveVideo": 300, "RelightViewer": 420}
PLACE = ("x", "y", "width", "height")
CORE = {  # ComfyUI's own nodes: inputs in their order, and types of the outputs
    "LoadImage": ({"image": "COMBO", "upload": "COMBO"}, ("IMAGE", "MASK")),
    "SaveImage": ({"images": "IMAGE", "filename_prefix": "STRING"}, ()),
    "PreviewImage": ({"images": "IMAGE"}, ()),
    "EmptyImage": ({name: "INT" for name in ("width", "height", "batch_size", "color")}, ("IMAGE",)),
    "ImageCrop": ({"image": "IMAGE"} | {name: "INT" for name in (*PLACE[2:], *PLACE[:2])}, ("IMAGE",)),
    "CropMask": ({"mask": "MASK"} | {name: "INT" for name in PLACE}, ("MASK",)),
    "SolidMask": ({"value": "FLOAT", "width": "INT", "height": "INT"}, ("MASK",)),
    "FeatherMask": (
        {"mask": "MASK"} | {name: "INT" for name in ("left", "top", "right", "bottom")}, ("MASK",)
    ),
    "MaskComposite": (
        {"destination": "MASK", "source": "MASK", "x": "INT", "y": "INT", "operation": "COMBO"}, ("MASK",)
    ),
    "ImageCompositeMasked": (
        {"destination": "IMAGE", "source": "IMAGE", "x": "INT", "y": "INT", "resize_source": "BOOLEAN",
         "mask": "MASK"},
        ("IMAGE",),
    ),
    "CreateVideo": ({"images": "IMAGE", "fps": "FLOAT", "audio": "AUDIO"}, ("VIDEO",)),
    "SaveVideo": (
        {"video": "VIDEO", "filename_prefix": "STRING", "format": "COMBO", "codec": "COMBO"}, ()
    ),
}  # fmt: skip


def default_of(kind: str, name: str) -> Any:
    """Return what a widget holds that a workflow does not set."""
    if kind in CORE:
        return "image" if name == "upload" else None
    inputs = NODE_CLASS_MAPPINGS[kind].INPUT_TYPES()
    return (inputs.get("required", {}) | inputs.get("optional", {}))[name][1]["default"]


def described(kind: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the inputs of a node class, {name: type} in their order, and the types of its outputs."""
    if kind in CORE:
        return CORE[kind]
    node = NODE_CLASS_MAPPINGS[kind]
    inputs = node.INPUT_TYPES()
    every = inputs.get("required", {}) | inputs.get("optional", {})
    types = {name: form[0] if isinstance(form[0], str) else "COMBO" for name, form in every.items()}
    return types, node.RETURN_TYPES


def interface_of(graph: dict[str, Any]) -> dict[str, Any]:
    """Return a workflow in API format as the interface saves it."""
    links: list[list[Any]] = []
    nodes: dict[str, dict[str, Any]] = {}
    depths: dict[str, int] = {}
    bottoms: dict[int, int] = {}
    for order, (number, node) in enumerate(graph.items()):
        inputs, outputs = described(node["class_type"])
        given = node["inputs"]
        linked = {name: value for name, value in given.items() if isinstance(value, list)}
        depths[number] = 1 + max((depths[source] for source, _ in linked.values()), default=-1)
        sockets, values = [], []
        for name, kind in inputs.items():
            if kind in WIDGETS and name not in linked:
                values.append(given[name] if name in given else default_of(node["class_type"], name))
                continue
            link = None
            if name in linked:
                source, slot = linked[name]
                link = len(links) + 1
                links.append([link, int(source), slot, int(number), len(sockets), kind])
                nodes[source]["outputs"][slot]["links"].append(link)
            sockets.append({"name": name, "type": kind, "link": link})
        height = SLOT * max(len(sockets), len(outputs)) + WIDGET * len(values) + 16
        height += SHOWS.get(node["class_type"], 0)
        top = bottoms.get(depths[number], 0)
        bottoms[depths[number]] = top + height + GAP
        nodes[number] = {
            "id": int(number), "type": node["class_type"], "title": node["_meta"]["title"],
            "pos": [COLUMN * depths[number], top], "size": [WIDTH, height],
            "flags": {}, "order": order, "mode": 0, "inputs": sockets,
            "outputs": [{"name": kind, "type": kind, "links": []} for kind in outputs],
            "properties": {"Node name for S&R": node["class_type"]}, "widgets_values": values,
        }  # fmt: skip
    return {
        "last_node_id": max(map(int, nodes)), "last_link_id": len(links), "nodes": list(nodes.values()),
        "links": links, "groups": [], "config": {}, "extra": {}, "version": 0.4,
    }  # fmt: skip


if __name__ == "__main__":
    OFFERED.mkdir(exist_ok=True)
    for file in sorted(HERE.glob("*.json")):
        text = json.dumps(interface_of(json.loads(file.read_text())), indent=1)
        (OFFERED / file.name).write_text(text + "\n")
