"""The node that takes the person out of their photograph, so that the relit one stands in it."""

from typing import Annotated

import torch

from relight.comfyui import host, tensors, widgets
from relight.comfyui.subjects import SubjectBatch


class CleanPlate(widgets.Node):
    """The photograph without the person."""

    DESCRIPTION = (
        "The photograph without the person, as a background for Relight Render: nothing of the old picture "
        "shows along the edge of the new one."
    )
    RETURN_TYPES = ("IMAGE",)
    RETURN_NAMES = ("background",)
    OUTPUT_TOOLTIPS = ("The photograph, whose surroundings go on under the person.",)
    FUNCTION = "clean"

    def clean(
        self,
        subject: Annotated[SubjectBatch, widgets.SUBJECT],
        image: Annotated[torch.Tensor, widgets.Socket("IMAGE", "The photographs that were analysed.")],
    ) -> tuple[torch.Tensor]:
        """Fill each frame as `relight.Subject.clean_plate` does."""
        images = tensors.pictures("image", image)
        count = tensors.frames_together(subject=len(subject), image=len(images))
        frames = []
        for number in host.progress(range(count), count):
            plate = tensors.light("image", images[number if len(images) > 1 else 0])
            frames.append(subject[number].clean_plate(plate[..., :3]))
        return (tensors.to_image(frames),)
