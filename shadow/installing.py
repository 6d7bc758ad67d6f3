"""How this installation is given an extra: the name `relight` on the package index is not this project's."""

import json
from importlib import metadata
from urllib.parse import unquote, urlsplit
from urllib.request import url2pathname

DISTRIBUTION = "relight"


def install_command(extra: str) -> str:
    """Return the command that installs an extra, for the way in which this distribution was installed.

    From a folder or a wheel (PEP 610, `direct_url.json`) pip takes the same path with the extra behind it;
    from a repository its address. Without a record, the reader fills in the folder of the source.

    >>> install_command("matte").endswith("[matte]'")
    True
    """
    try:
        record = json.loads(metadata.distribution(DISTRIBUTION).read_text("direct_url.json") or "null")
    except (metadata.PackageNotFoundError, ValueError):
        record = None
    if not isinstance(record, dict) or not isinstance(record.get("url"), str):
        return f"python -m pip install '/folder/of/relight[{extra}]', where /folder/of/relight is its source"
    url = record["url"]
    if url.startswith("file:"):
        return f"python -m pip install '{url2pathname(unquote(urlsplit(url).path))}[{extra}]'"
    version = record.get("vcs_info")
    if isinstance(version, dict):
        url = f"{version.get('vcs')}+{url}@{version.get('commit_id')}"
    return f"python -m pip install '{DISTRIBUTION}[{extra}] @ {url}'"
