"""Errors name a command that installs an extra from where the package came from."""

import json
from importlib import metadata

import pytest

from shadow.installing import install_command


@pytest.mark.parametrize(
    ("record", "command"),
    [
        ({"url": "file:///plates/my%20clone", "dir_info": {"editable": True}}, "'/plates/my clone[key]'"),
        ({"url": "file:///w/relight-0.2.0-py3-none-any.whl"}, "'/w/relight-0.2.0-py3-none-any.whl[key]'"),
        (
            {"url": "https://example.org/r.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            "'relight[key] @ git+https://example.org/r.git@abc'",
        ),
        (None, "'/folder/of/relight[key]', where /folder/of/relight is its source"),
    ],
)
def test_the_command_is_that_of_the_installation(monkeypatch, record, command):
    class Distribution:
        def read_text(self, name):
            return None if record is None else json.dumps(record)

    monkeypatch.setattr(metadata, "distribution", lambda name: Distribution())
    assert install_command("key") == f"python -m pip install {command}"
