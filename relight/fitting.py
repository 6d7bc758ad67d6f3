"""The light that a picture was taken in, as lights."""

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.subject import Subject


def fit_lights(image: np.ndarray, subject: Subject | None = None) -> list[DirectionalLight]:
    """The lights in which a person looks most like a picture: the photograph's own, or a reference's.

    Non-negative weights over the 96 OLAT directions, by least squares of image = albedo × Σ weight × shading
    (`shading.infer_lighting`). To put somebody into the light of a reference picture, fit the reference and
    give its lights to the other's `Subject.relit`.

    Parameters
    ----------
    image: (H, W, 3|4) as `relight.Subject` takes it.
    subject: the Subject of that picture, or of another of the same person, posed and framed alike; made from
        the image, which then needs alpha, unless given.

    Returns
    -------
    DirectionalLights, the strongest first, named `fit1`, `fit2`...; none of a black picture. The exposure is
    in the lights. The colours of a subject's own photograph are in its albedo: together such lights are about
    white, whatever colour each has.

    Raises
    ------
    TypeError, ValueError: as `relight.Subject`; an image of another size than the subject's.
    """
    subject = Subject(image) if subject is None else subject
    directions, powers = subject.fitted(image)
    order = np.argsort(-powers.sum(axis=1), kind="stable")
    shining = [index for index in order if powers[index].any()]
    return [
        DirectionalLight(directions[index].tolist(), colour=powers[index].tolist(), name=f"fit{number}")
        for number, index in enumerate(shining, 1)
    ]
