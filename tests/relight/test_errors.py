"""Errors that callers tell apart: each has its class, and is a ValueError or an OSError as well."""

import json

import numpy as np
import pytest
from safetensors.numpy import save_file

import relight
from relight import errors
from relight.empty_subject import load_subject


def test_a_matte_without_a_person_has_its_class():
    image = np.full((64, 48, 3), 0.3, np.float32)
    for mask in (np.zeros((64, 48), np.float32), np.zeros((64, 48), np.uint8)):
        with pytest.raises(errors.EmptyMatteError, match="mask: is empty") as caught:
            relight.Subject(image, mask)
        assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ({}, errors.DamagedFileError),
        ({"format": 2, "made_of": {}}, errors.StaleAnalysisError),
        ({"format": 4, "provenance": {}, "empty": [4, 4]}, errors.EmptyMatteError),
    ],
)
def test_files_that_are_no_analysis_of_this_version_have_classes(tmp_path, header, kind):
    save_file({}, tmp_path / "kept.safetensors", {"relight": json.dumps(header)})
    with pytest.raises(kind) as caught:
        relight.Subject.load(tmp_path / "kept.safetensors")
    assert isinstance(caught.value, errors.RelightError)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "size", [[4], [], {"a": 1}, 5, "ab", [-1, 4], [1.5, 2], [0, 0], [10**9, 10**9], [30000, 30000], [True, 4]]
)
def test_an_empty_frame_of_no_size_is_damaged(tmp_path, size):
    header = {"format": 4, "provenance": {"weights": []}, "arrays": {}, "empty": size}
    save_file({}, tmp_path / "000001.safetensors", {"relight": json.dumps(header)})
    with pytest.raises(errors.DamagedFileError, match=r"000001\.safetensors: "):
        load_subject(tmp_path / "000001.safetensors")


def test_missing_frames_are_missing_files():
    assert issubclass(errors.MissingFramesError, FileNotFoundError)
