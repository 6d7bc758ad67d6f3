"""What workers import, of Dask or of the application, to run the networks on a small canvas as tests do."""

from helpers.damage import small_canvas

canvas = small_canvas()
canvas.__enter__()  # for as long as the worker lives
