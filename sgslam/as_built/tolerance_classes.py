"""Tolerances: lengths that a user writes, and the levels of accuracy of USIBD."""

import math
import re

from data.common.errors import UserError

# m, upper limits of the levels of the U.S. Institute of Building Documentation's specification (LOA 3.0)
LOA = (("LOA50", 0.001), ("LOA40", 0.005), ("LOA30", 0.015), ("LOA20", 0.05))
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


def loa_class(offset_m: float) -> str:
    """The level of accuracy that an offset keeps: `LOA50` (1 mm), 40 (5 mm), 30 (15 mm), 20 (50 mm), else `LOA10`."""
    return next((name for name, limit in LOA if abs(offset_m) <= limit), "LOA10")
