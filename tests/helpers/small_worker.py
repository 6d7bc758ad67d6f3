"""What Dask workers preload that run the networks: they do so on a small canvas, as the tests do."""

from helpers.damage import small_canvas

canvas = small_canvas()
canvas.__enter__()  # for as long as the worker lives
