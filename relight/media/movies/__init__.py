"""Movies in and out through PyAV: alpha, colour, fields and pixel shapes as their containers say them."""

from relight.media.movies.reading import RATE, READ, MatteMovie, Movie, is_movie, read_comment
from relight.media.movies.tracks import Tracks
from relight.media.movies.writing import (
    FASTEST,
    SLOWEST,
    WHITE,
    WRITTEN,
    frame_codes,
    frame_rate,
    write_codes,
    write_movie,
)
