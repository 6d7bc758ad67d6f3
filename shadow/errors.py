"""The base of the errors that callers may want to tell apart, in all three packages; see `relight.errors`."""


class RelightError(Exception):
    """The base of these errors: `except RelightError` catches them all."""


class EmptyMatteError(RelightError, ValueError):
    """A matte, a mask or a photograph shows no person: no coverage is above one half."""
