"""Numbers as text, and the signals of a map's quality in words."""

import math
from collections.abc import Mapping
from typing import Any

NOTHING = "\N{EN DASH}"
SIGNALS = {  # the names in metrics.json: phrase, unit, and which side of the limit is sound
    "map_against_odometry": ("difference of map and odometry, share of the path length", " %", "at most"),
    "lost_scans": ("lost scans, share of all", " %", "at most"),
    "unplaced_scans": ("scans in parts that were not placed, share of all", " %", "at most"),
    "keyframes_without_walls": ("keyframes that see no wall, share of all", " %", "at most"),
    "walls_per_keyframe": ("walls that a keyframe sees, mean", "", "at least"),
    "position_sigma_m": ("standard deviation of 95 % of the positions", " m", "at most"),
    "place_probability": ("probability of the place", " %", "at least"),
}


def thousands(value: int | None) -> str:
    """With a comma between thousands."""
    return NOTHING if value is None else f"{value:,}"


def percent(probability: float) -> str:
    """A probability, never as certain."""
    if 0.0005 <= probability < 0.9995:
        return f"{100 * probability:.1f} %"
    return "over 99.9 %" if probability > 0.5 else "under 0.1 %"


def metres(value: float | None) -> str:
    """A length, in mm below 1 m."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value * 1000:.1f} mm" if abs(value) < 1 else f"{value:.2f} m"


def seconds(value: float | None) -> str:
    """A time, in ms below 1 s."""
    return NOTHING if value is None else f"{value:.1f} s" if abs(value) >= 1 else f"{value * 1000:.0f} ms"


def signal_texts(name: str, signal: Mapping[str, Any]) -> tuple[str, str, str]:
    """Phrase, value and limit of a signal of quality, as in metrics.json."""
    phrase, unit, side = SIGNALS[name]
    value, limit = (signal[key] * (100 if unit == " %" else 1) for key in ("value", "limit"))
    return phrase, f"{value:.3g}{unit}", f"{side} {limit:g}{unit}"
