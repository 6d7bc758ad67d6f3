"""PIFuHD checkpoints as others write them, with few channels."""

import argparse

import torch

from shadow.networks.pifuhd import FrontNormals


def save(path, parameters, legacy=False, **more):
    """As PIFuHD's training saved it: the parts of the whole method, and two Namespaces of options."""
    options = argparse.Namespace(
        name="pifuhd_final", loadSize=1024, mlp_dim=[257, 1024], use_back_normal=True
    )
    others = {
        "netG.netB.model.1.weight": torch.zeros(2, 3, 7, 7),
        "image_filter.conv1.weight": torch.ones(1),
    }
    checkpoint = {
        "epoch": 1,
        "opt": options,
        "opt_netG": options,
        "model_state_dict": parameters | others,
        **more,
    }
    torch.save(checkpoint, path, _use_new_zipfile_serialization=not legacy)
    return path


def narrow(seed=0):
    """Parameters of a generator of 2 channels instead of 64, under PIFuHD's keys."""
    torch.manual_seed(seed)
    network = FrontNormals(2)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.5)
    return {f"netG.netF.{key}": value.detach() for key, value in network.state_dict().items()}
