"""Bands of wall offsets in millimetres, which have the same colours in every drawing."""

import math
from collections.abc import Mapping
from typing import Any

LIMITS_MM = (10, 30, 100)
# from the wall that stands furthest back, out of its room, to the one that stands furthest into it
BANDS = ("back-3", "back-2", "back-1", "as-planned", "into-1", "into-2", "into-3")
UNPLANNED = "unplanned"  # in tables, beside the verdicts on planned elements
MINUS = "\N{MINUS SIGN}"


def band_of(offset_m: float | None) -> str | None:
    """The band of an offset along the plan's inward normal; None where there is no offset."""
    if offset_m is None:
        return None
    steps = sum(abs(offset_m) * 1000 >= limit for limit in LIMITS_MM)
    return BANDS[len(LIMITS_MM) + (steps if offset_m > 0 else -steps)]


def band_labels() -> dict[str, str]:
    """The label of each band, in millimetres."""
    near, middle, far = LIMITS_MM
    texts = (f"over {far}", f"{middle} to {far}", f"{near} to {middle}")
    back = [f"{text} mm back" for text in texts]
    into = [f"{text} mm into the room" for text in reversed(texts)]
    return dict(zip(BANDS, [*back, f"under {near} mm off", *into], strict=True))


def signed_mm(offset_m: float | None) -> str:
    """An offset as text, such as `+12.3 mm`."""
    return "" if offset_m is None else f"{_signed(offset_m * 1000, 1)} mm"


def degrees(tilt_rad: float | None) -> str:
    """A tilt as text, such as `+0.04°`."""
    return "" if tilt_rad is None else f"{_signed(math.degrees(tilt_rad), 2)}°"


def deviation_text(deviation: Mapping[str, Any]) -> str:
    """One line for a tooltip of the wall."""
    reason = [str(deviation["reason"])] if deviation.get("reason") else []
    if deviation["kind"] != "moved":
        return ", ".join([deviation["kind"], *(["significant"] if deviation["significant"] else []), *reason])
    parts = [f"offset {signed_mm(deviation['offset_m'])}"]
    if deviation.get("sigma_m") is not None:
        parts.append(f"sigma {deviation['sigma_m'] * 1000:.1f} mm")
    if deviation.get("tilt_rad") is not None:
        parts.append(f"tilt {degrees(deviation['tilt_rad'])}")
    return ", ".join([*parts, *reason])


def _signed(value: float, digits: int) -> str:
    text = f"{abs(value):.{digits}f}"
    sign = "" if float(text) == 0 else "+" if value > 0 else MINUS
    return sign + text
