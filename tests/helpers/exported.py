"""Exported people as other programs see them: validators, Mitsuba through the exported camera."""

import http.server
from contextlib import contextmanager

import numpy as np
from PIL import Image


def usd_complaints(path):
    """What all validators of OpenUSD say of a stage."""
    from pxr import Usd, UsdValidation

    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    return [
        f"{error.GetName()}: {error.GetMessage()}" for error in context.Validate(Usd.Stage.Open(str(path)))
    ]


def path_traced(path, light, height, *, samples=16, bounces=1, floor=False):
    """A stage's person through its camera, as Mitsuba renders it: (H, W, 4) linear, straight alpha.

    `light`: (3,) unit direction to a distant light of power 1. `height`: of the picture, pixels. `bounces`: 0
    is direct light alone. `floor`: a grey plane at y = 0.
    """
    import mitsuba as mi
    from pxr import Gf, Usd, UsdGeom, UsdShade

    mi.set_variant("scalar_rgb")
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.XformCache()
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    frustum = camera.GetCamera(Usd.TimeCode.Default())
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Person/Mesh"))
    place = np.array(cache.GetLocalToWorldTransform(mesh.GetPrim()))
    points = np.array(mesh.GetPointsAttr().Get()) @ place[:3, :3] + place[3, :3]
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get()) * (1, -1) + (
        0,
        1,
    )  # Mitsuba counts from above
    texture = UsdShade.Shader(stage.GetPrimAtPath("/World/Person/Material/Texture"))
    file = texture.GetInput("file").Get().resolvedPath
    pixels = np.asarray(Image.open(file))
    opacity = (pixels[..., 3:] >= 128).astype(np.float32)

    def bitmap(values, raw):
        return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(values)), "raw": raw,
                "wrap_mode": "clamp", "filter_type": "nearest" if raw else "bilinear"}  # fmt: skip

    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(
        {
            "type": "mask",
            "opacity": bitmap(opacity, True),
            "nested": {
                "type": "twosided",
                "nested": {"type": "diffuse", "reflectance": bitmap(pixels[..., :3], False)},
            },
        }
    )
    solid = mi.Mesh("person", len(points), len(faces), properties, has_vertex_normals=True,
                    has_vertex_texcoords=True)  # fmt: skip
    parameters = mi.traverse(solid)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    normals = np.array(mesh.GetNormalsAttr().Get()) @ place[:3, :3]
    parameters["vertex_normals"] = normals.astype(np.float32).ravel()
    parameters["vertex_texcoords"] = st.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()

    world = np.array(cache.GetLocalToWorldTransform(camera.GetPrim()))
    eye, look, up = world[3, :3], -world[2, :3], world[1, :3]
    aspect = frustum.aspectRatio
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": bounces + 2, "rr_depth": 99},
        "sensor": {
            "type": "perspective",
            "fov": frustum.GetFieldOfView(Gf.Camera.FOVVertical),
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(
                origin=eye.tolist(), target=(eye + look).tolist(), up=up.tolist()
            ),
            "film": {"type": "hdrfilm", "width": round(height * aspect), "height": height,
                     "pixel_format": "rgba", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "light": {"type": "directional", "direction": (-np.asarray(light)).tolist(), "irradiance": np.pi},
        "person": solid,
    }  # fmt: skip
    if floor:
        scene["floor"] = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale([20, 20, 1]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}},
        }
    return np.array(mi.render(mi.load_dict(scene)))


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *words):
        pass


THREE_PAGE = """<!doctype html><meta charset="utf-8"><body style="margin:0">
<script type="importmap">{"imports": {"three": "./node_modules/three/build/three.module.js"}}</script>
<script type="module">
import * as three from "three";
import { GLTFLoader } from "./node_modules/three/examples/jsm/loaders/GLTFLoader.js";
const { scene, cameras } = await new GLTFLoader().loadAsync("./person.glb");
const renderer = new three.WebGLRenderer({ alpha: true, preserveDrawingBuffer: true });
const height = HEIGHT, width = Math.round(cameras[0].aspect * height);
renderer.setSize(width, height);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);
scene.traverse((node) => {
  if (node.isMesh) node.castShadow = node.receiveShadow = true;
  if (node.isDirectionalLight) {
    node.castShadow = true;
    Object.assign(node.shadow.camera, { left: -1.5, right: 1.5, top: 2, bottom: -2, near: -5, far: 5 });
    node.shadow.mapSize.set(2048, 2048);
    node.shadow.normalBias = 0.02;
  }
});
window.draw = (name) => {
  scene.traverse((node) => { if (node.isLight) node.visible = node.name === name; });
  renderer.render(scene, cameras[0]);
  return [width, height, renderer.domElement.toDataURL("image/png")];
};
window.loaded = true;
</script>"""


@contextmanager
def three_js(folder, glb, height):
    """three.js with an exported person in Chromium: from a light's name to (H, W, 4), encoded."""
    import base64
    import functools
    import io
    import shutil
    import subprocess
    import threading

    from helpers import browsing

    npm = shutil.which("npm")
    assert npm, "install node and npm"
    subprocess.run([npm, "install", "--silent", "--prefix", folder, "three@0.187.0"], check=True)
    shutil.copyfile(glb, folder / "person.glb")
    (folder / "page.html").write_text(THREE_PAGE.replace("HEIGHT", str(height)))
    handler = functools.partial(_Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with browsing.browser() as browser:
            page = browser.new_page()
            page.complaints = []
            page.on("pageerror", lambda error: page.complaints.append(str(error)))
            page.goto(f"http://127.0.0.1:{server.server_address[1]}/page.html")
            browsing.wait(page, "Boolean(window.loaded)")

            def draw(name):
                _, _, url = page.evaluate("(name) => draw(name)", name)
                return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))) / 255

            yield draw
        server.shutdown()
