"""The base of the errors that callers may want to tell apart, in all three packages; see `relight.errors`."""


class RelightError(Exception):
    """The base of these errors: `except RelightError` catches them all."""


class EmptyMatteError(RelightError, ValueError):
    """A matte, a mask or a photograph shows no person: no coverage is above one half."""


def refuse_gradient(name: str, value: object) -> None:
    """Raise ValueError for a tensor that requires a gradient: none flows from what is computed here."""
    if getattr(value, "requires_grad", False):
        raise ValueError(
            f"{name}: requires a gradient, which is not computed here; give {name}.detach(), "
            "or use differences"
        )
