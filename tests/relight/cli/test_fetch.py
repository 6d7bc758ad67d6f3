"""`relight fetch person`: the networks that find people, from a wheel that is named."""

import hashlib
import zipfile

from typer.testing import CliRunner

from relight.cli.commands import app
from relight.matting.people import files as person_files


def test_it_says_what_it_brings_and_where_it_is(tmp_path, monkeypatch):
    monkeypatch.setenv("RELIGHT_CACHE", str(tmp_path))
    known = {
        name: (place, hashlib.sha256(b"x").hexdigest()) for name, (place, _) in person_files.FILES.items()
    }
    monkeypatch.setattr(person_files, "FILES", known)
    with zipfile.ZipFile(tmp_path / "m.whl", "w") as archive:
        for place in (*(place for place, _ in known.values()), person_files.LICENCE):
            archive.writestr(place, b"x")
    done = CliRunner().invoke(app, ["fetch", "person", "--wheel", str(tmp_path / "m.whl")])
    assert done.exit_code == 0, done.output
    assert "Apache-2.0" in done.output
    assert str(tmp_path / "person") in done.output
    assert person_files.are_fetched()
    refused = CliRunner().invoke(app, ["fetch", "person", "--wheel", str(tmp_path / "missing.whl")])
    assert refused.exit_code == 2
    assert "missing.whl: no such file" in refused.output
