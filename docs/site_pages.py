"""Make the pages of the documentation site that do not lie in docs; run by the MkDocs plugin gen-files.

The README becomes the first page. The changelog, the contributors' guide and the model card join the guides.
There is a reference page for each package, with the public names in its `__all__`.
"""

import re
from pathlib import Path

import mkdocs_gen_files

import relight
import shading
import shadow

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "shadow/weights/MODEL_CARD.md": "model_card.md",
    "benchmarks/tables/report.md": "tables.md",
    "benchmarks/tables/from-scratch/report.md": "tables_from_scratch.md",
    "benchmarks/tables/from-scratch/shading.md": "table_6_from_scratch.md",
}
LINK = re.compile(r"(?<=\]\()(?!https?:|#)([^)\s#]+)")


def on_site(target: str, page: Path) -> str:
    """Return where a link of `page`, a path in the repository, leads on the site."""
    path = (page.parent / target).resolve().relative_to(ROOT).as_posix()
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if path.endswith((".png", ".json")):
        with mkdocs_gen_files.open(path, "wb") as file:
            file.write((ROOT / path).read_bytes())
    return path


def write_page(source: Path, name: str) -> None:
    """Write a page of the repository as the page `name` of the site."""
    text = LINK.sub(lambda match: on_site(match[1], source), source.read_text())
    with mkdocs_gen_files.open(name, "w") as file:
        file.write(text)


for source, name in PAGES.items():
    write_page(ROOT / source, name)
for guide in sorted((ROOT / "docs").glob("*.md")):
    write_page(guide, guide.name)
for package in (relight, shading, shadow):
    with mkdocs_gen_files.open(f"api/{package.__name__}.md", "w") as file:
        file.write(f"# {package.__name__}\n\n{package.__doc__}\n\n")
        for name in package.__all__:
            found = getattr(package, name)
            file.write(f"::: {found.__module__}.{name}\n\n")
        if package is relight:
            file.write("::: relight.errors\n\n")
