"""`python -m relight.cli`: the command line, as `torchrun -m` starts it."""

from relight.cli import app

app()
