"""The viewer's panel: what it says of a light, the room from above, the surround; the panel on a phone."""

import numpy as np
import pytest
from helpers import browsing

import relight
from relight.viewer.initial_state import parameters_of

pytest.importorskip("playwright")
pytestmark = browsing.NEEDS_CHROMIUM

PHONES = {"390": (390, 844), "320": (320, 568), "landscape": (844, 390), "small landscape": (667, 375)}


def lamp_at(page, position, **settings):
    """Make the selected light a lamp."""
    lamp = parameters_of(relight.PointLight(position, name="lamp", **settings))
    page.evaluate(
        "(lamp) => relight.viewer.change((state) => "
        "(state.lights = [{ muted: false, solo: false, ...lamp }]) && (state.selected = 0))",
        lamp,
    )
    browsing.settled(page)


@pytest.mark.slow
def test_buttons_of_a_light_carry_its_name(page):
    for does in ("Solo", "Mute", "Delete"):
        assert page.get_by_role("button", name=f"{does} key", exact=True).count() == 1
    page.get_by_label("Name of light 1").fill("window")
    page.get_by_label("Name of light 1").press("Enter")
    browsing.settled(page)
    page.get_by_role("button", name="Solo window", exact=True).click()
    assert browsing.state(page)["lights"][0]["solo"]


@pytest.mark.slow
def test_kelvin_is_off_where_a_light_has_no_temperature(page):
    browsing.press(page, "2")
    field, slider = page.get_by_label("Kelvin, exactly"), page.get_by_label("Kelvin", exact=True)
    assert field.input_value() == "off"
    assert slider.get_attribute("aria-valuetext") == "off"
    field.fill("3200")
    field.press("Enter")
    browsing.settled(page)
    assert browsing.state(page)["lights"][1]["temperature"] == 3200
    assert slider.get_attribute("aria-valuetext") == "3200 K"
    field.fill("off")
    field.press("Enter")
    browsing.settled(page)
    assert browsing.state(page)["lights"][1]["temperature"] is None


@pytest.mark.slow
def test_kelvin_of_daylight_ends_where_daylight_does(page):
    page.evaluate("relight.viewer.change((state) => (state.lights[0].locus = 'daylight'))")
    browsing.settled(page)
    page.get_by_label("Kelvin, exactly").fill("2000")
    page.get_by_label("Kelvin, exactly").press("Enter")
    browsing.settled(page)
    assert browsing.state(page)["lights"][0]["temperature"] == 4000


@pytest.mark.slow
@pytest.mark.parametrize("key", ["Backspace", "Delete", "PageUp"])
def test_keys_of_a_slider_do_nothing_to_the_lights(page, key):
    lamp_at(page, (-0.6, 0.4, 0.8))
    page.get_by_label("Radius", exact=True).focus()
    browsing.press(page, key)
    (light,) = browsing.state(page)["lights"]
    assert light["position"] == [-0.6, 0.4, 0.8]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("position", "exposure", "said"),
    [
        ((0, 0, 2), 2, "1 · +0.00 stops"),
        ((0, 3, 4), 0, "0.04 · −4.64 stops"),
        ((0.5, 0, 0.5), 0, "2 · +1.00 stops"),
    ],
)
def test_a_lamp_says_what_arrives_at_the_person(page, position, exposure, said):
    lamp_at(page, position, exposure=exposure)
    assert page.locator(".meter output").inner_text() == said
    browsing.press(page, "d")
    assert not page.locator(".meter").is_visible()


@pytest.mark.slow
def test_a_lamp_is_moved_in_depth_from_above_and_from_the_side(page):
    lamp_at(page, (-0.6, 0.4, 0.8))
    before = browsing.state(page)["lights"][0]["position"]
    above, side = page.locator(".plan canvas").all()
    extent = page.evaluate("relight.viewer.controls.inspector.plan.extent")

    def drag(view, start, end):
        """From and to places in metres, to the right and down from the view's middle."""
        box = view.bounding_box()
        spots = [
            (
                box["x"] + box["width"] * (0.5 + across / (2 * extent)),
                box["y"] + box["height"] * (0.5 + down / (2 * extent)),
            )
            for across, down in (start, end)
        ]
        page.mouse.move(*spots[0])
        page.mouse.down()
        page.mouse.move(*spots[1])
        page.mouse.up()
        browsing.settled(page)
        return browsing.state(page)["lights"][0]["position"]

    above.scroll_into_view_if_needed()
    found = drag(above, (-0.6, 0.8), (0.3, 1.0))  # the camera is below the view, and +z downward
    np.testing.assert_allclose(found, [0.3, before[1], 1.0], atol=0.03)
    found = drag(side, (1.0, -before[1]), (0.5, -0.1))  # the camera is at the right, and +y upward
    np.testing.assert_allclose(found, [0.3, 0.1, 0.5], atol=0.03)
    browsing.press(page, "Control+z")
    np.testing.assert_allclose(
        browsing.state(page)["lights"][0]["position"], [0.3, before[1], 1.0], atol=0.03
    )


@pytest.mark.slow
def test_the_surround_is_chosen_and_kept_and_every_text_can_be_read_beside_it(page):
    page.get_by_label("Lights", exact=True).scroll_into_view_if_needed()
    browsing.press(page, "a")
    browsing.press(page, "m")
    lamp_at(page, (-0.6, 0.4, 0.8))
    colours = {"Dark": "rgb(27, 27, 27)", "Light": "rgb(220, 220, 220)", "Grey": "rgb(118, 118, 118)"}
    for name, colour in colours.items():
        choice = page.get_by_role("radiogroup", name="Surround").get_by_label(name, exact=True)
        choice.check(force=True)
        browsing.settled(page)
        assert page.evaluate("getComputedStyle(relight.viewer.root).backgroundColor") == colour
        assert not browsing.low_contrast(page)
        browsing.press(page, "?")
        assert not browsing.low_contrast(page)
        browsing.press(page, "Escape")
    page.reload()
    browsing.wait(page, "Boolean(window.relight)")
    assert page.evaluate("relight.viewer.root.dataset.surround") == "grey"
    assert page.get_by_label("Grey", exact=True).is_checked()


@pytest.mark.slow
def test_nothing_moves_for_those_who_ask_for_no_motion(page):
    page.emulate_media(reduced_motion="reduce")
    moving = browsing.moving(page)
    page.emulate_media(reduced_motion="no-preference")
    assert moving == []


@pytest.fixture(scope="module")
def phone(browser, page_file):
    """The page on a phone: fingers, no mouse."""
    page = browsing.opened(browser, page_file, size=PHONES["390"], has_touch=True, is_mobile=True)
    yield page
    assert not page.complaints
    page.context.close()


def sheet(page):
    return page.evaluate("relight.viewer.root.dataset.sheet")


def room_for_the_picture(page):
    box = page.locator(".stage").bounding_box()
    return box["width"] * box["height"]


@pytest.mark.slow
@pytest.mark.parametrize("name", PHONES)
def test_the_panel_of_a_phone_is_pulled_up_and_let_down(phone, name):
    width, height = PHONES[name]
    phone.set_viewport_size({"width": width, "height": height})
    phone.evaluate("relight.viewer.root.dataset.sheet = 'middle'")
    browsing.settled(phone)
    shown = [one for one in phone.locator(".panel > *, .panel header > *").all() if one.is_visible()]
    assert max(box["x"] + box["width"] for box in map(type(shown[0]).bounding_box, shown)) <= width
    middle = room_for_the_picture(phone)
    grip = phone.locator(".grip").bounding_box()
    x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
    phone.mouse.move(x, y)
    phone.mouse.down()
    phone.mouse.move(*((0.35 * width, y) if width > height else (x, 0.3 * height)), steps=3)
    phone.mouse.up()
    browsing.settled(phone)
    assert sheet(phone) == "high"
    assert room_for_the_picture(phone) < middle
    phone.locator(".grip").tap()  # from high to low
    browsing.settled(phone)
    assert sheet(phone) == "low"
    assert room_for_the_picture(phone) > middle
    phone.locator(".grip").focus()
    phone.keyboard.press("ArrowUp")
    assert sheet(phone) == "middle"


@pytest.mark.slow
def test_keys_on_the_grip_move_no_light(phone):
    before = phone.evaluate("relight.viewer.state.lights")
    phone.locator(".grip").focus()
    phone.keyboard.press("ArrowUp")
    phone.keyboard.press("ArrowUp")
    assert phone.evaluate("relight.viewer.state.lights") == before


@pytest.mark.slow
def test_what_goes_out_is_one_menu_on_a_phone(phone):
    phone.set_viewport_size(dict(zip(("width", "height"), PHONES["390"], strict=True)))
    names = ["Copy lights", "Copy command", "Copy link", "Save PNG"]
    assert not any(phone.get_by_role("button", name=name, exact=True).is_visible() for name in names)
    menu = phone.get_by_role("button", name="Copy and save", exact=True)
    menu.tap()
    assert menu.get_attribute("aria-expanded") == "true"
    assert all(phone.get_by_role("button", name=name, exact=True).is_visible() for name in names)
    assert phone.evaluate("document.activeElement.textContent") == "Copy lights"
    phone.keyboard.press("Escape")
    assert menu.get_attribute("aria-expanded") == "false"
    assert not phone.get_by_role("button", name="Save PNG", exact=True).is_visible()
    assert phone.evaluate("document.activeElement.getAttribute('aria-label')") == "Copy and save"


@pytest.mark.slow
def test_help_begins_with_gestures_where_there_is_no_mouse(phone, page):
    phone.evaluate("relight.viewer.actions.help()")
    assert phone.locator(".help h3").first.inner_text() == "Fingers"
    assert phone.get_by_text("Pinch, drag two fingers", exact=True).is_visible()
    assert not phone.get_by_text("Wheel", exact=True).is_visible()
    phone.get_by_text("Mouse and keyboard").tap()
    assert phone.get_by_text("Wheel", exact=True).is_visible()
    phone.keyboard.press("Escape")
    page.evaluate("relight.viewer.actions.help()")
    assert page.locator(".help h3").first.inner_text() == "Mouse"
