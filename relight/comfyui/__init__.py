"""ComfyUI nodes: relight a person, or a shot of one, in a workflow.

The nodes have ComfyUI's plain class form and import nothing of it. `relight comfyui PATH` registers them in a
ComfyUI folder; see docs/comfyui.md.
"""

from pathlib import Path

from relight.comfyui.analyse import Analyse
from relight.comfyui.clean_plate import CleanPlate
from relight.comfyui.lights import Environment, Lamp, LightNode, Preset
from relight.comfyui.match import Match
from relight.comfyui.render import Orbit, Passes, Render
from relight.comfyui.save_exr import SaveEXR
from relight.comfyui.viewer import Viewer

NODES = {
    "Analyse": Analyse,
    "Light": LightNode,
    "Lamp": Lamp,
    "Environment": Environment,
    "Preset": Preset,
    "Clean Plate": CleanPlate,
    "Render": Render,
    "Passes": Passes,
    "Match": Match,
    "Orbit": Orbit,
    "Save EXR": SaveEXR,
    "Viewer": Viewer,
}
NODE_CLASS_MAPPINGS = {f"Relight{title.replace(' ', '')}": node for title, node in NODES.items()}
NODE_DISPLAY_NAME_MAPPINGS = {f"Relight{title.replace(' ', '')}": f"Relight {title}" for title in NODES}
WEB_DIRECTORY = str(Path(__file__).parent / "web")  # the extension that shows the viewer inside its node
