"""Links of the page that say odd things; a kind of hostile inputs.

One browser and one page serve all inputs of a process: a link is followed by changing the page's fragment.
"""

import atexit
from contextlib import ExitStack
from pathlib import Path
from random import Random
from urllib.parse import quote

import relight
from helpers import browsing, hostile
from helpers.damage import kept_person
from helpers.invariants import Violation, require

KEYS = (
    *("light", "muted", "solo", "selected", "environment", "dark", "map", "picture", "background"),
    *("look", "wipe", "exposure", "constructor", "__proto__"),
)
_open: list = []  # the page
# Not a number in the state would become null in JSON.
STATE = "JSON.stringify(relight.viewer.state, (key, value) => Number.isNaN(value) ? 'NaN' : value)"


def page_fragment(random: Random, folder: Path) -> None:
    """A link: the page keeps a state that is one, and says in words what it does not take."""
    page = _page(folder)
    del page.complaints[:]
    fragment = _fragment(random)
    page.evaluate("(text) => { location.hash = text; }", fragment)
    page.wait_for_timeout(20)
    require(not page.complaints, f"{fragment!r} ended in the console: {page.complaints}")
    state = page.evaluate(STATE)
    if '"NaN"' in state and "NaN" not in fragment:
        raise Violation(f"{fragment!r} made a state that is no number")


def _fragment(random: Random) -> str:
    settings = []
    for key in random.choices(KEYS, k=random.randrange(1, 4)):
        words = [
            f"{name}={hostile.text_value(random, name)}"
            for name in random.sample(hostile.PARAMETERS, random.randrange(4))
        ]
        odd = str(random.choice(hostile.NUMBERS + hostile.WORDS))
        value = ",".join(words) if random.random() < 0.7 else odd
        settings.append(f"{key}={value}")
    text = "&".join(settings)
    text = hostile.edited(random, text) if random.random() < 0.4 else text
    return quote(text.encode("utf-8", "replace"), safe="=&,:/%")


def _page(folder: Path):
    if not _open:
        closing = ExitStack()
        atexit.register(closing.close)
        path = folder / "page.html"
        relight.Subject.load(kept_person(folder)).view(path)
        _open.append(browsing.opened(closing.enter_context(browsing.browser()), path))
    return _open[0]
