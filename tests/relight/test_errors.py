"""Errors that callers tell apart: each has its class, and is a ValueError or an OSError as well."""

import json

import numpy as np
import pytest
from safetensors.numpy import save_file

import relight
from relight import errors
from relight.analysis.storage import FORMAT
from relight.pipeline.cache import AnalysisCache
from relight.subject import weights

PROVENANCE = {
    "weights": list(weights()), "options": "x", "precision": "float32", "content_hash": "x", "sources": [],
}  # fmt: skip


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
        ({"format": FORMAT, "provenance": {}, "empty": [4, 4]}, errors.EmptyMatteError),
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
@pytest.mark.parametrize("version", [FORMAT - 1, FORMAT])
def test_an_empty_frame_of_no_size_is_damaged_whatever_its_format(tmp_path, size, version):
    header = {"format": version, "provenance": {"weights": []}, "arrays": {}, "empty": size}
    save_file({}, tmp_path / "000001.safetensors", {"relight": json.dumps(header)})
    with pytest.raises(errors.DamagedFileError, match=r"000001\.safetensors: "):
        relight.Subject.load(tmp_path / "000001.safetensors", may_be_empty=True)


@pytest.mark.parametrize(
    "said",
    [
        *(
            {"provenance": {key: value for key, value in PROVENANCE.items() if key != name}}
            for name in PROVENANCE
        ),
        *({"provenance": PROVENANCE | {name: [{}]}} for name in ("weights", "sources")),
        *({"provenance": value} for value in ([], None, "x", 3)),
        "[" * 10_000,
        '{"format": ' + "9" * 5000 + "}",
        f'{{"format": {FORMAT}, "format": 1e999}}',
        "\ud800",
    ],
)
@pytest.mark.states("Analysis caches", "no provenance, or no JSON, in a header", "refused")
def test_a_frame_that_does_not_say_what_it_was_made_of_is_damaged(tmp_path, said):
    """But for what is amiss it is the frame of somebody who is not there."""
    (tmp_path / "c.relight").mkdir()
    path = tmp_path / "c.relight" / "still.safetensors"
    header = {"format": FORMAT, "empty": [64, 48], "arrays": {}, "provenance": PROVENANCE}
    text = said if isinstance(said, str) else json.dumps(header | said)
    content = json.dumps({"__metadata__": {"relight": text}}).encode()
    path.write_bytes(len(content).to_bytes(8, "little") + content)
    with pytest.raises((OSError, ValueError), match=r"still\.safetensors|c\.relight") as caught:
        AnalysisCache(tmp_path / "c.relight").read(0)
    assert "\n" not in str(caught.value)


def test_missing_frames_are_missing_files():
    assert issubclass(errors.MissingFramesError, FileNotFoundError)
