"""The light step in a browser: the floor's shadow, looking at the picture, copying and saving it."""

import io

import numpy as np
import pytest
from helpers import ROOT, browsing
from helpers.serving import LIT, at_step, chosen, saved_picture, served, visited
from PIL import Image

pytestmark = [pytest.mark.slow, browsing.NEEDS_CHROMIUM]
VIEWER = "relightApp.parts.light.viewer"
SHOWN = f"""() => {{
    const {{ engine }} = {VIEWER};
    {VIEWER}.redraw();
    const look = {{ exposure: 0, background: {VIEWER}.shownBackground() }};
    const {{ width, height, data }} = engine.readShown("picture", look);
    return [height, width, Array.from(data)];
}}"""


@pytest.fixture(scope="module")
def address():
    with served() as (found, _):
        yield found


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A person with alpha, with room below the feet."""
    path = tmp_path_factory.mktemp("photo") / "stands.png"
    person = Image.open(ROOT / "examples" / "person.png").resize((160, 314))
    picture = Image.new("RGBA", (320, 400))
    picture.paste(person, (80, 40))
    picture.save(path)
    return path


@pytest.fixture(scope="module")
def opened(browser, address, photo):
    """The light step with the photograph, and the state that it begins with."""
    page = visited(browser, address, permissions=["clipboard-read", "clipboard-write"])
    chosen(page, photo)
    at_step(page, "light")
    browsing.wait(page, LIT, 240)
    yield page, page.evaluate(f"{VIEWER}.state")
    page.context.close()


@pytest.fixture
def page(opened):
    found, state = opened
    found.evaluate("relightApp.go('light')")
    at_step(found, "light")
    found.evaluate(f"(state) => {VIEWER}.change((now) => Object.assign(now, state))", state)
    found.evaluate(f"(relightApp.hush(), {VIEWER}.stage.message.replaceChildren())")
    browsing.settled(found)
    yield found
    assert not [line for line in found.complaints if "willReadFrequently" not in line]


def shown(page):
    height, width, data = page.evaluate(SHOWN)
    return np.reshape(np.array(data, np.float32), (height, width, 4))[..., :3] / 255


def middle(page):
    """Where the stage's middle is, and how wide and high it is."""
    left, top, width, height = page.evaluate(
        f"""(({{ left, top, width, height }}) => [left, top, width, height])(
            {VIEWER}.stage.element.getBoundingClientRect())"""
    )
    return left + width / 2, top + height / 2, width, height


def test_the_shadow_on_the_floor_is_a_switch_and_what_is_shown_is_saved(page, tmp_path):
    page.evaluate(f"{VIEWER}.change((state) => (state.background = [0.5, 0.5, 0.5]))")
    page.evaluate(f"{VIEWER}.change((state) => {{ state.lights.length = 1; state.lights[0].azimuth = 60; }})")
    browsing.settled(page)
    before = shown(page)
    page.get_by_role("switch", name="Shadow on the floor").check()
    browsing.wait(page, f"Boolean({VIEWER}.engine.floorShadow)", 60)
    browsing.settled(page)
    with_floor = shown(page)
    assert (with_floor <= before + 0.01).all()
    assert (before - with_floor).max() > 0.2  # beside the feet
    saved = saved_picture(page, tmp_path / "saved.png") / 255
    assert np.abs(saved - with_floor).mean() < 0.004
    page.get_by_role("slider", name="Horizon", exact=True).fill("0.3")
    page.get_by_role("button", name="Save files…").click()
    at_step(page, "save")
    assert "--floor horizon=0.3" in page.get_by_label("Command line", exact=True).inner_text()
    assert "floor=relight.Floor(horizon=0.3)" in page.get_by_label("Python", exact=True).inner_text()
    page.evaluate("relightApp.go('light')")
    at_step(page, "light")
    page.get_by_role("switch", name="Shadow on the floor").uncheck()
    browsing.wait(page, f"!{VIEWER}.engine.floorShadow")
    browsing.settled(page)
    np.testing.assert_array_equal(shown(page), before)


def test_where_the_frame_cuts_the_feet_off_there_is_no_floor(browser, address, tmp_path):
    Image.open(ROOT / "examples" / "person.png").crop((0, 0, 410, 300)).save(tmp_path / "cut.png")
    page = visited(browser, address)
    chosen(page, tmp_path / "cut.png")
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    page.evaluate(f"{VIEWER}.change((state) => (state.background = [0.5, 0.5, 0.5]))")
    browsing.settled(page)
    switch = page.get_by_role("switch", name="Shadow on the floor")
    switch.click()
    browsing.settled(page)
    assert "cuts the feet off" in page.locator(".relight .message").inner_text()
    assert not switch.is_checked()
    page.context.close()


def test_a_click_on_nothing_changes_nothing_and_the_wheel_zooms(page):
    state = f"JSON.stringify({VIEWER}.state)"
    before = page.evaluate(state)
    x, y, width, height = middle(page)
    for across, down in ((0, 0), (0.4, -0.3), (-0.45, 0.4)):
        page.mouse.click(x + across * width, y + down * height)
    browsing.settled(page)
    assert page.evaluate(state) == before
    scale = f"{VIEWER}.stage.scale"
    fitted = page.evaluate(scale)
    page.mouse.move(x, y)
    page.mouse.wheel(0, -600)
    browsing.wait(page, f"{scale} > {1.5 * fitted}")
    page.keyboard.press("0")
    browsing.wait(page, f"{scale} === {fitted}")
    assert page.evaluate(state) == before


def test_space_and_the_button_show_the_photograph_while_held_after_help_too(page):
    page.get_by_role("button", name="Help").click()
    page.get_by_role("button", name="Close").click()
    browsing.settled(page)
    held = f"{VIEWER}.held"
    page.keyboard.down(" ")
    browsing.settled(page)
    assert page.evaluate(held)
    page.keyboard.up(" ")
    assert not page.evaluate(held)
    box = page.get_by_role("button", name="Before").bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    assert page.evaluate(held)
    page.mouse.up()
    assert not page.evaluate(held)


def test_the_picture_is_copied_as_it_is_shown(page):
    page.evaluate(f"{VIEWER}.change((state) => (state.background = [0.1, 0.2, 0.3]))")
    page.get_by_role("button", name="Copy picture").click()
    browsing.wait(page, f"{VIEWER}.stage.message.textContent.includes('copied')")
    codes = page.evaluate(
        """async () => {
            const [item] = await navigator.clipboard.read();
            return Array.from(new Uint8Array(await (await item.getType("image/png")).arrayBuffer()));
        }"""
    )
    copied = np.asarray(Image.open(io.BytesIO(bytes(codes))).convert("RGB"), np.float32) / 255
    np.testing.assert_allclose(copied, shown(page), atol=0.01)


def test_a_save_tells_how_far_it_is_and_can_be_cancelled(page, tmp_path):
    page.evaluate(
        """() => {
            const seen = (window.shares = []);
            const show = relightApp.showShare.bind(relightApp);
            relightApp.showShare = (share) => (seen.push([relightApp.doing.textContent, share]), show(share));
        }"""
    )
    assert saved_picture(page, tmp_path / "saved.png").shape == (400, 320, 4)
    at_step(page, "light")
    told = page.evaluate("shares")
    shares = [share for _, share in told if share is not None]
    assert shares == sorted(shares)
    assert len(shares) >= 3
    assert "Relighting…" in [what for what, _ in told]
    page.evaluate(
        """async () => {
            const saving = relightApp.parts.save.save(".png");
            while (!window.relightApp.progress.open) await new Promise((done) => setTimeout(done, 1));
            relightApp.cancel.click();
            await saving;
        }"""
    )
    assert page.locator(".notice span").inner_text() == "Cancelled."
    assert saved_picture(page, tmp_path / "again.png").shape == (400, 320, 4)  # and the server goes on


COVERED = """(() => {
    const box = (one) => one.getBoundingClientRect();
    const others = [...document.querySelectorAll(".hint, .message:not(:empty), .view-tools")];
    const [notice, shown] = [box(relightApp.message), others.filter((one) => one.checkVisibility())];
    return shown.filter((one) => {
        const other = box(one);
        const beside = notice.left >= other.right || other.left >= notice.right;
        return !beside && notice.top < other.bottom && other.top < notice.bottom;
    }).map((one) => one.outerHTML);
})()"""


def test_messages_cover_no_hint_and_go_away(page):
    for step in ("light", "save", "outline"):
        page.evaluate(f"relightApp.go('{step}')")
        at_step(page, step)
        page.evaluate("relightApp.tell('A sentence of the usual length, which says what has been done.')")
        browsing.settled(page)
        assert page.evaluate(COVERED) == [], step
    browsing.wait(page, "relightApp.message.hidden", 15)


def test_the_browser_s_back_goes_a_step_back(page):
    page.evaluate("relightApp.go('save')")
    at_step(page, "save")
    page.go_back()
    at_step(page, "light")


def test_a_drag_on_a_slow_machine_is_drawn_coarser_and_the_picture_follows(page):
    page.evaluate(f"{VIEWER}.openDraft()")
    browsing.wait(page, f"Boolean({VIEWER}.draft)")
    page.evaluate(f"{VIEWER}.change((state) => (state.lights[0].azimuth += 20), 'drag')")
    browsing.settled(page)
    assert page.evaluate(f"{VIEWER}.draft.shown")
    coarse = page.evaluate(f"{VIEWER}.draft.engine.size")
    assert max(coarse) <= 400
    page.evaluate(f"{VIEWER}.endGesture()")
    browsing.wait(page, f"!{VIEWER}.draft.shown")
    # both show the same light
    means = page.evaluate(
        f"""() => {{
            const {{ draft, engine, state }} = {VIEWER};
            draft.draw({VIEWER});
            return [draft.engine, engine].map((one) => {{
                const {{ data }} = one.readShown("light", {{ exposure: 0, background: null }});
                const sums = [0, 0];
                data.forEach((value, at) => (sums[Number(at % 4 === 3)] += value));
                return sums[0] / sums[1] / 3;
            }});
        }}"""
    )
    assert means[0] == pytest.approx(means[1], rel=0.05)
    page.evaluate(f"({VIEWER}.showDraft(false), ({VIEWER}.draft = null))")
