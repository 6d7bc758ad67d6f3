"""Texts of options that begin with the name of a file."""

import numpy as np
import pytest

import relight
from relight.matting.sequence import MattingOptions
from relight.media.option_texts import split_file_and_settings
from relight.pipeline.options import Lighting

ODD = ("studio, f=2.8.exr", "a,b=1.exr", "x=1,y=2.hdr", "a,b.exr")


@pytest.mark.parametrize("name", [*ODD, "a.exr", 'a"b,c=1.exr'])
@pytest.mark.parametrize("settings", ["", ",rotation=0", ",rotation=90,intensity=2"])
def test_a_name_with_commas_and_equals_signs_is_the_file_that_is_there(tmp_path, here, name, settings):
    relight.write(name, np.ones((16, 32, 3), np.float32))
    relight.write("a.exr", np.full((16, 32, 3), 7, np.float32))
    words = settings.split(",")[1:]
    assert split_file_and_settings(f"{name}{settings}") == (name, words)
    assert str(relight.EnvironmentLight.parse(f"{name}{settings}").settings()["image"]) == name
    Lighting(environment=(f"{name}{settings}",)).rig()  # as the app and the command ask for it
    assert MattingOptions.parse(f"{name},mean=0.5/0.5/0.5").model == name


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("settings", ["", ",rotation=90", ",rotation=90,intensity=2"])
def test_a_name_in_quotes_needs_no_file(name, settings):
    assert split_file_and_settings(f'"{name}"{settings}') == (name, settings.split(",")[1:])


@pytest.mark.parametrize("text", ['"a.exr', '"a.exr"x,rotation=3', '"'])
def test_quotes_that_do_not_end_are_refused(text):
    with pytest.raises(ValueError, match=r'expected "NAME",settings'):
        split_file_and_settings(text)
    with pytest.raises(ValueError, match=r'expected "NAME",settings'):
        relight.EnvironmentLight.parse(text)


def test_without_a_file_of_that_name_a_setting_ends_it():
    assert split_file_and_settings("a,b.exr,rotation=3,x") == ("a,b.exr", ["rotation=3", "x"])
    assert split_file_and_settings("x" * 9999 + ",a=1") == ("x" * 9999, ["a=1"])
