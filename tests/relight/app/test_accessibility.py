"""The application's main states by axe-core, at the sizes of a desktop, a tablet and a phone."""

import pytest
from helpers import ROOT, browsing
from helpers.serving import LIT, OUTLINED, at_step, served, visited

AXE = ROOT / ".ci" / "javascript" / "node_modules" / "axe-core" / "axe.min.js"  # npm ci brings it
pytestmark = [
    pytest.mark.slow,
    browsing.NEEDS_CHROMIUM,
    pytest.mark.skipif(not AXE.exists(), reason="no axe-core: npm ci, in .ci/javascript"),
]
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
RUN = """async (rules) => {
    const { violations, passes } = await axe.run(document, { runOnly: rules });
    const said = violations.flatMap(({ id, nodes }) => nodes.map(({ html }) => `${id}: ${html}`));
    return [said, passes.length];
}"""


def findings(page):
    """What axe finds in a page as it is."""
    if not page.evaluate("Boolean(window.axe)"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    found, passed = page.evaluate(RUN, RULES)
    assert passed > 10  # it has looked
    return found


def test_axe_finds_nothing_in_the_main_states(browser):
    with served() as (address, _):
        page = visited(browser, address)
        assert findings(page) == []
        page.get_by_role("button", name="Try the example").click()
        at_step(page, "light")
        browsing.wait(page, LIT, 240)
        page.get_by_role("button", name="Paint the light").click()
        assert findings(page) == []
        page.get_by_role("button", name="Done").click()
        page.evaluate("document.querySelectorAll('.panel details').forEach((one) => (one.open = true))")
        assert findings(page) == []
        page.evaluate("relightApp.go('outline')")
        browsing.wait(page, OUTLINED, 240)
        for size in ((1280, 800), (820, 1180), (390, 844)):
            page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
            for step in ("drop", "outline", "light", "save"):
                page.evaluate(f"relightApp.go('{step}')")
                at_step(page, step)
                browsing.settled(page)
                assert findings(page) == [], (size, step)
        page.evaluate("relightApp.tell('Something is said.', true, ['Do it', () => {}])")
        assert findings(page) == []
        page.evaluate("document.querySelector('.save h2').style.color = '#999'")
        assert any("color-contrast" in one for one in findings(page))  # it would find something
        page.context.close()
