"""Movies in and out through PyAV: alpha, colour, fields and pixel shapes as their containers say them."""

from relight.media.movies.forms import BY_SUFFIX, Codec, Form, Hdr
from relight.media.movies.read_movie import RATE, READ, MatteMovie, Movie, is_movie, read_comment
from relight.media.movies.tracks import Tracks
from relight.media.movies.write_movie import (
    FASTEST,
    SLOWEST,
    WHITE,
    WRITTEN,
    frame_codes,
    frame_rate,
    write_codes,
    write_movie,
)
