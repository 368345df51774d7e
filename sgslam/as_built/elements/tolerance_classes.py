"""Tolerances: lengths that a user writes, USIBD's levels of accuracy, and the limits of DIN 18202."""

import math
import re
from typing import Literal

from data.common.errors import UserError

Compliance = Literal["within", "outside", "not conclusive"]
SURE_SIGMAS = 2.0  # as the guard band of JCGM 106: 95 % coverage
# m, upper limits of the levels of the U.S. Institute of Building Documentation's specification (LOA 3.0), which holds
# at 95 % confidence
LOA = (("LOA50", 0.001), ("LOA40", 0.005), ("LOA30", 0.015), ("LOA20", 0.05))
# m, DIN 18202, table 2: lengths of a surface, and how far one of its ends may lie off its planned direction
_ANGLE_LIMITS = (
    (0.5, 0.003),
    (1.0, 0.006),
    (3.0, 0.008),
    (6.0, 0.012),
    (15.0, 0.016),
    (30.0, 0.020),
    (math.inf, 0.030),
)
# m, by class, of DIN 18202, table 1: dimensions in plan and heights, both of 3 to 6 m; openings of 1 to 3 m
DIN_18202 = {"wall": 0.016, "slab": 0.016, "opening": 0.012}
_UNITS = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001}
_SMALLEST, _LARGEST = 0.001, 0.2  # m: below the first nothing is measured, above the second walls are other walls


def parse_length(text: str) -> float:
    """Metres, of `15mm`, `15 mm`, `1.5cm`, `0.015`. Raises UserError for anything else, and out of 1 to 200 mm."""
    found = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(mm|cm|m|)\s*", text)
    if found is None:
        raise UserError(f"--tolerance {text}: not a length; write e.g. 15mm, 1.5cm or 0.015 (metres)")
    value = float(found[1]) * _UNITS[found[2]]
    if not (math.isfinite(value) and _SMALLEST <= value <= _LARGEST):
        raise UserError(f"--tolerance {text}: {value:g} m is out of range; give 1 mm to 200 mm")
    return value


def loa_class(sigma_m: float) -> str:
    """The level of accuracy of a measurement, by two standard deviations (95 %).

    `LOA50` up to 1 mm, `LOA40` 5 mm, `LOA30` 15 mm, `LOA20` 50 mm, else `LOA10`.
    """
    return next((name for name, limit in LOA if SURE_SIGMAS * sigma_m <= limit), "LOA10")


def is_off(verdict: str, offset_m: float, sigma_m: float) -> bool:
    """Whether an element was moved by more than the measurement error explains."""
    return verdict == "moved" and abs(offset_m) > SURE_SIGMAS * sigma_m


def angle_limit(length_m: float) -> float:
    """m, the largest deviation of a surface of this length from its planned direction by DIN 18202, table 2."""
    return next(limit for longest, limit in _ANGLE_LIMITS if length_m <= longest)


def compliance(deviation_m: float, sigma_m: float, limit_m: float) -> Compliance:
    """Whether a deviation is within the limit, where two standard deviations tell it from the limit."""
    margin = limit_m - abs(deviation_m)
    if abs(margin) <= SURE_SIGMAS * sigma_m:
        return "not conclusive"
    return "within" if margin > 0 else "outside"
