"""The viewer: one self-contained page, or a widget in a notebook, in which one holds the light."""

SUFFIXES = (".html", ".htm")  # of pages
