"""ComfyUI nodes: relight a person, or a shot of one, in a workflow.

The nodes have ComfyUI's plain class form and import nothing of it. `relight comfyui PATH` registers them in a
ComfyUI folder; see docs/comfyui.md.
"""

from pathlib import Path

from relight.comfyui.analyse import Analyse
from relight.comfyui.lights import Environment, Lamp, LightNode, Preset
from relight.comfyui.match import Match
from relight.comfyui.render import Orbit, Passes, Render
from relight.comfyui.save_exr import SaveEXR
from relight.comfyui.viewer import Viewer

NODE_CLASS_MAPPINGS = {
    "RelightAnalyse": Analyse,
    "RelightLight": LightNode,
    "RelightLamp": Lamp,
    "RelightEnvironment": Environment,
    "RelightPreset": Preset,
    "RelightRender": Render,
    "RelightPasses": Passes,
    "RelightMatch": Match,
    "RelightOrbit": Orbit,
    "RelightSaveEXR": SaveEXR,
    "RelightViewer": Viewer,
}
NODE_DISPLAY_NAME_MAPPINGS = {
    "RelightAnalyse": "Relight Analyse",
    "RelightLight": "Relight Light",
    "RelightLamp": "Relight Lamp",
    "RelightEnvironment": "Relight Environment",
    "RelightPreset": "Relight Preset",
    "RelightRender": "Relight Render",
    "RelightPasses": "Relight Passes",
    "RelightMatch": "Relight Match",
    "RelightOrbit": "Relight Orbit",
    "RelightSaveEXR": "Relight Save EXR",
    "RelightViewer": "Relight Viewer",
}
WEB_DIRECTORY = str(Path(__file__).parent / "web")  # the extension that shows the viewer inside its node
