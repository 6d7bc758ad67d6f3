"""Texts of backgrounds: colours, words and files."""

import pytest

from relight.quantities import BACKGROUNDS, background_of


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("black", (0, 0, 0)),
        ("White", (1, 1, 1)),
        ("#ff0000", (1, 0, 0)),
        ("0.2/0.3/0.4", (0.2, 0.3, 0.4)),
        ("street.jpg", "street.jpg"),
        ("folder/street", "folder/street"),
        *((word, word) for word in BACKGROUNDS),
    ],
)
def test_a_background_is_a_colour_a_word_or_a_file(text, meant):
    assert background_of(text) == meant


def test_grey_is_that_of_pictures():
    assert background_of("grey") == pytest.approx((0.2159,) * 3, abs=1e-4)


def test_a_file_comes_before_a_colour(here):
    (here / "tan").touch()
    assert background_of("tan") == "tan"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("blak", "did you mean black"),
        ("blurr", "did you mean blur"),
        ("0.2,0.2,0.2", "as 0.2/0.2/0.2"),
        ("#20", "#rrggbb"),
    ],
)
def test_what_is_none_of_these_is_refused(text, says):
    with pytest.raises(ValueError, match=says):
        background_of(text)


def test_codes_of_8_bits_are_warned_of():
    with pytest.warns(UserWarning, match="background: 255/128/0 is linear .*#ff8000"):
        background_of("255/128/0")
