"""`python -m helpers.small_command`: the command `relight`, with the networks on a small canvas."""

from helpers.damage import small_canvas
from relight.cli.__main__ import main

with small_canvas():
    main()
