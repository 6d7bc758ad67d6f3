"""Ten frames in a rising light, for tests of interruptions."""

import relight
from helpers import shots
from helpers.standins import somebody

RISING = relight.MovingLight(intensity={1: 0.1, 5: 0.5}, name="key")
STILL = relight.DirectionalLight(intensity=0.5, name="key")


def make(output, analyse):
    """Ten frames in a rising light, of persons that `analyse` gives."""
    settings = {"background": (0.1, 0.1, 0.1), "frames": (1, 10), "resume": True}
    assert shots.render(somebody(), RISING, output, analyse=analyse, **settings) == {}
