"""A program as a user writes it: tests/test_types.py gives it to type checkers."""

import numpy as np
import torch

import relight
import shading
import shadow
from relight.errors import EmptyMatteError, RelightError

image = relight.read("a.png")
key = relight.DirectionalLight(azimuth=-40, name="key")
lights: list[relight.Light] = [key, relight.PointLight((0.5, 0.2, 1.0), radius=0.1)]
subject: relight.Subject = relight.Subject(image, mask=relight.read_mask("matte.png"))
relit: np.ndarray = subject.relit([key])
relight.write("b.exr", relit, layers=subject.layers(lights))
subject.visibility([[0.0, 0.0, 1.0]])
subject.shading(torch.tensor([[0.0, 0.0, 1.0]]))
lighting = relight.Lighting(light=[key, "rim:azimuth=150"], background="0.03/0.03/0.04")
relight.render_shot(relight.Source("a.png"), lighting, relight.Output("c.exr"), compute=relight.Compute())
relight.apply(image.tolist(), "rembrandt", mask=torch.ones(64, 48))
analysis = shading.analyse(torch.zeros(64, 48, 3), [[1.0, 0.0]])
analysis.shading([[0.0, 0.0, 1.0]])
shadow.infer(np.zeros((64, 48, 3)), np.ones((64, 48)), [(0.0, 0.6, 0.8)])
try:
    relight.Subject.load("kept.safetensors")
except EmptyMatteError:
    pass
except RelightError as error:
    print(error)
