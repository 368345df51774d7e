"""Numbers as text."""

NOTHING = "\N{EN DASH}"


def thousands(value: int | None) -> str:
    """With a comma between thousands."""
    return NOTHING if value is None else f"{value:,}"


def metres(value: float | None) -> str:
    """A length, in cm below 1 m."""
    if value is None:
        return NOTHING
    return f"{value * 100:.1f} cm" if abs(value) < 1 else f"{value:.2f} m"


def seconds(value: float | None) -> str:
    """A time, in ms below 1 s."""
    return NOTHING if value is None else f"{value:.1f} s" if abs(value) >= 1 else f"{value * 1000:.0f} ms"
