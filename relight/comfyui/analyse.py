"""The node that analyses a person: what all others start from."""

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
import torch
from annotated_types import Interval

from relight.arguments import About
from relight.comfyui import host, tensors, widgets
from relight.comfyui.subjects import SubjectBatch, each_person
from relight.lights.environment import FIELD_OF_VIEW
from relight.matting.networks import AUTO
from relight.matting.refine import is_opaque
from relight.matting.sequence import MattingOptions, SequenceMatting
from relight.subject import Subject
from shadow.directions import from_axes

SHOT, SEPARATE = "one shot", "separate pictures"  # what a batch is
NORMAL_AXES = ("+x+y+z", "+x-y+z", "-x+y+z", "+x-y-z")
TO_CAMERA = np.array([0, 0, 1], np.float32)


class Analyse(widgets.Node):
    """Infer normals, albedo, depth and self-shadowing of the person in each image."""

    DESCRIPTION = (
        "Analyses the person once; then any number of lights costs a weighted sum and no network. A batch is "
        "a shot: its frames share one room and are filtered in time. ComfyUI keeps the result in its cache."
    )
    RETURN_TYPES = ("RELIGHT_SUBJECT", "IMAGE", "IMAGE", "IMAGE")
    RETURN_NAMES = ("subject", "albedo", "normals", "depth")
    OUTPUT_TOOLTIPS = (
        "The analysed person.",
        "The person's colour without light.",
        "Normals as a picture: red to image right, green up, blue to the camera.",
        "Depth as a picture: near is white, far is black, in a batch by one scale.",
    )
    FUNCTION = "analyse"

    def analyse(
        self,
        image: Annotated[torch.Tensor, widgets.Socket("IMAGE", "The photograph, or the frames of a shot.")],
        mask_shows: widgets.MaskShows = tensors.PERSON,
        batch: Annotated[
            str,
            widgets.Choice((SHOT, SEPARATE)),
            About("Whether the images are one shot, filtered in time, or have no order."),
        ] = SHOT,
        height: Annotated[
            float,
            Interval(ge=0.05, le=20.0),
            widgets.Step(0.01),
            About("Metres of the person that the first image shows; less in a portrait."),
        ] = 1.75,
        field_of_view: Annotated[
            float,
            Interval(ge=1.0, le=170.0),
            widgets.Step(1.0),
            About("Of the photograph's camera, vertical, in degrees."),
        ] = FIELD_OF_VIEW,
        *,
        mask: Annotated[
            torch.Tensor | None,
            widgets.Socket(
                "MASK", "The person's matte, one or one a frame. Without it and alpha the person is found."
            ),
        ] = None,
        normals: Annotated[
            torch.Tensor | None,
            widgets.Socket("IMAGE", "A picture of normals to use instead of inferring them."),
        ] = None,
        normal_axes: Annotated[
            str,
            widgets.Choice(NORMAL_AXES),
            About(
                "What red, green and blue of the normals run along: +x+y+z is right, up, to the camera "
                "(OpenGL); +x-y+z has its green turned over (DirectX)."
            ),
        ] = NORMAL_AXES[0],
        depth: Annotated[
            torch.Tensor | None,
            widgets.Socket(
                "IMAGE",
                "A picture of depth, such as Depth Anything's, instead of what the normals say. Its scale is "
                "fitted to theirs, either way up.",
            ),
        ] = None,
    ) -> tuple[SubjectBatch, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Analyse each image on the device that it is on."""
        plates = tensors.pictures("image", image)
        given: dict[str, np.ndarray] = {}
        if mask is not None:
            given["mask"] = tensors.mattes("mask", mask, plates.shape[1:3], mask_shows)
        if normals is not None:
            given["normals"] = _normals(normals, normal_axes)
        if depth is not None:
            given["depth"] = _relative(tensors.pictures("depth", depth)[..., 0])
        count = tensors.frames_together(
            image=len(plates), **{name: len(maps) for name, maps in given.items()}
        )
        if count > len(plates):
            raise ValueError(f"image: expected as many images as there are masks or maps, {count}")

        frames = list(range(len(plates))) if batch == SHOT and len(plates) > 1 else None
        matting = SequenceMatting(
            MattingOptions(AUTO), lambda number: tensors.light("image", plates[number]), frames
        )

        def analyse(number: int, first: Subject | None) -> Subject:
            plate = tensors.light("image", plates[number])
            maps: dict[str, Any] = {
                name: maps[number if len(maps) > 1 else 0] for name, maps in given.items()
            }
            if "mask" not in maps and is_opaque(plate):
                plate, maps["mask"] = matting.matte(number)
            coverage = maps.get("mask", plate[..., -1])
            if len(plates) > 1 and coverage.max() <= 0.5:
                return Subject.nobody((plate.shape[0], plate.shape[1]))
            return Subject(
                plate,
                height=height,
                field_of_view=field_of_view,
                camera=None if first is None else first.camera,
                old_light=None if first is None else first.old_light,
                device=image.device,
                **maps,
            )

        pictures = _Pictures()
        people = pictures.taken(host.progress(each_person(count, analyse, batch == SHOT), count))
        return (SubjectBatch(count, people), *pictures.images())


class _Pictures:
    """The pictures of what was found, taken while the subjects pass by."""

    def __init__(self) -> None:
        self._taken: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []

    def taken(self, people: Iterator[tuple[Subject, Subject]]) -> Iterator[tuple[Subject, Subject]]:
        """Yield the people, and take the pictures of each."""
        for analysed, person in people:
            matte = person.matte
            albedo = np.dstack([person.albedo * matte[..., None], matte])
            normals = np.where(matte[..., None] > 0, person.normals, TO_CAMERA)
            self._taken.append((albedo, normals / 2 + np.float32(0.5), person.depth, matte))
            yield analysed, person

    def images(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return IMAGEs of the albedo, the normals and the depth."""
        albedo, normals, depths, mattes = map(list, zip(*self._taken, strict=True))
        inside = [depth[matte > 0] for depth, matte in zip(depths, mattes, strict=True)]
        metres = np.concatenate(inside) if any(map(len, inside)) else np.zeros(1, np.float32)
        near, far = metres.min(), metres.max()
        nearness = [
            np.where(matte > 0, (far - depth) / max(far - near, 1e-6), 0).astype(np.float32)
            for depth, matte in zip(depths, mattes, strict=True)
        ]
        return tensors.to_image(albedo), torch.from_numpy(np.stack(normals)), tensors.as_grey(nearness)


def _normals(image: torch.Tensor, axes: str) -> np.ndarray:
    """Decode a picture of normals to normals (B, H, W, 3) in the camera frame."""
    vectors = (tensors.pictures("normals", image)[..., :3] * 2 - 1) @ from_axes(axes).T
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-3, vectors / np.maximum(length, 1e-3), TO_CAMERA).astype(np.float32)


def _relative(pictures: np.ndarray) -> np.ndarray:
    """Depth pictures as 16-bit integers, which `relight.Subject` takes for depth of unknown scale."""
    low, high = pictures.min(), pictures.max()
    return np.round((pictures - low) / max(high - low, 1e-6) * 65535).astype(np.uint16)
