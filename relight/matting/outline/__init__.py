"""Mattes from what a person draws: an outline, strokes, or a rough mask."""

from relight.matting.outline.drawing import (
    Outline,
    Stroke,
    inside_of,
    outlined,
    refine,
    refine_matte,
    shift_edge,
)
