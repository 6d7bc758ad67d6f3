"""What was dropped on the page travels by link, command and undo as far as it can; what cannot is said."""

import shlex

import numpy as np
import pytest
from helpers import browsing
from helpers.clothed import clothed

import relight
from relight.viewer.initial_state import scene_of

pytest.importorskip("playwright")
pytestmark = browsing.NEEDS_CHROMIUM


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    """A page that begins with an environment, which is the background too, and a key light."""
    plate, matte = clothed()
    radiance = np.zeros((16, 32, 3), np.float32)
    radiance[4, 9] = 40  # one lamp: a page draws it at once
    sky = relight.EnvironmentLight(radiance, name="sky")
    path = tmp_path_factory.mktemp("page") / "page.html"
    subject = relight.Subject(plate, matte)
    subject.view(
        path, [relight.DirectionalLight(name="key"), sky], background=sky, background_name="environment"
    )
    return browsing.policed(path)


def command(page):
    return shlex.split(page.evaluate("relight.command()"))


def said(page):
    return page.locator(".message").inner_text()


@pytest.mark.slow
def test_the_command_names_the_background_that_is_there(page):
    words = command(page)
    assert words[words.index("--background") + 1] == "environment"
    browsing.dropped(page, ".picture", "wall of mine.png", 24)
    words = command(page)
    assert words[words.index("--background") + 1] == "wall of mine.png"


def test_a_background_from_memory_is_left_out_of_the_command():
    background = np.full((4, 4, 3), 0.5, np.float32)
    assert scene_of((4, 4), background=background)["backdrop"]["name"] is None
    assert scene_of((4, 4), background=background, background_name="a.exr")["backdrop"]["name"] == "a.exr"


def test_a_fill_needs_a_background_that_is_an_image():
    image = np.full((4, 4, 3), 0.5, np.float32)
    about = scene_of((4, 4), background=image, fill=0.4)
    assert about["fill"] == 0.4
    assert np.shape(about["backdrop"]["lamps"])[1] == 6
    for background in (None, (0.1, 0.1, 0.1), relight.EnvironmentLight(image[:, :2].repeat(4, axis=1))):
        with pytest.raises(ValueError, match="fill: expected a background that is an image"):
            scene_of((4, 4), background=background, fill=0.4)
    for amount in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="fill: expected"):
            scene_of((4, 4), background=image, fill=amount)


@pytest.mark.slow
def test_an_environment_that_was_removed_stays_away(page, browser, page_file):
    page.get_by_label("Remove the environment").dispatch_event("click")
    browsing.settled(page)
    for key in ("c", "Shift+C"):
        browsing.press(page, key)  # a command and lights without it, and nothing fails
    assert "--environment" not in command(page)
    assert "environment" not in page.evaluate("relight.lights()")
    browsing.wait(page, "location.hash.includes('environment=none')")
    again = browsing.opened(browser, page_file, page.evaluate("location.hash.slice(1)"))
    assert browsing.state(again)["environment"] is None
    assert not again.complaints
    again.context.close()
    assert not page.complaints


@pytest.mark.slow
def test_what_a_link_cannot_hold_is_said_where_it_is_opened(page, browser, page_file):
    browsing.dropped(page, ".panel", "sky 1.png")
    browsing.dropped(page, ".picture", "wall.png", 24)
    browsing.wait(page, "location.hash.includes('wall.png')")
    again = browsing.opened(browser, page_file, page.evaluate("location.hash.slice(1)"))
    browsing.wait(again, "document.querySelector('.message').textContent.includes('wall.png')")
    assert "sky 1.png and wall.png" in said(again)
    assert browsing.state(again)["environment"] is None
    assert "" not in command(again)
    assert not again.complaints
    again.context.close()


@pytest.mark.slow
def test_undo_brings_dropped_files_back(page):
    browsing.dropped(page, ".panel", "sky 1.png")
    browsing.dropped(page, ".panel", "sky 2.png")
    browsing.press(page, "Control+z")
    assert page.evaluate("relight.viewer.environment.path") == "sky 1.png"
    browsing.press(page, "Control+z")
    assert page.evaluate("relight.viewer.environment.path") == "environment.exr"
    browsing.press(page, "Control+y", "Control+y")
    assert page.evaluate("relight.viewer.environment.path") == "sky 2.png"
    browsing.dropped(page, ".picture", "red.png", 24, "#f00")
    browsing.dropped(page, ".picture", "blue.png", 24, "#00f")
    browsing.press(page, "Control+z")
    assert command(page)[command(page).index("--background") + 1] == "red.png"
    assert page.evaluate("relight.viewer.engine.backdrop.rgb[0]") == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "fragment", ["light=locus=constructor", "light=constructor=1", "light=__proto__=1,toString=2"]
)
def test_a_link_with_names_of_the_language_is_refused_in_a_sentence(browser, page_file, fragment):
    page = browsing.opened(browser, page_file, fragment)
    browsing.wait(page, "document.querySelector('.message').textContent.includes('cannot be used')")
    assert not page.complaints
    page.context.close()


@pytest.mark.slow
def test_no_exception_ends_in_the_console_alone(page):
    page.evaluate("setTimeout(() => { throw new Error('a defect'); })")
    browsing.wait(page, "document.querySelector('.message').textContent.includes('a defect')")
    page.evaluate("setTimeout(() => Promise.reject(new Error('another')))")
    browsing.wait(page, "document.querySelector('.message').textContent.includes('another')")
    page.complaints.clear()  # both, as the browser's console has them


@pytest.mark.slow
def test_small_values_travel(page, tmp_path):
    small = "{ intensity: 2e-5, colour: [1, 3e-7, 0] }"
    page.evaluate(f"relight.viewer.change((state) => Object.assign(state.lights[0], {small}))")
    browsing.settled(page)
    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()").split('  - name: "sky"')[0])
    (light,) = relight.read_lights(tmp_path / "lights.yaml")
    words = command(page)
    parsed = relight.DirectionalLight.parse(words[words.index("--light") + 1])
    for found in (light, parsed):
        assert found.intensity == pytest.approx(2e-5)
        assert found.colour == pytest.approx((1, 3e-7, 0))
    browsing.wait(page, "location.hash.includes('e-')")
