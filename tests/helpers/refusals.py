"""How a file is refused."""

import pytest

import relight


def first_line(path, function=relight.read, **arguments):
    """The error of a file, which is one line that begins with its name."""
    with pytest.raises(ValueError, match="a") as caught:
        function(path, **arguments)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text
