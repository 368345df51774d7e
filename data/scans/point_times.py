"""Times of single points, as LiDAR drivers write them: under several names, in several units."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Stamped = Literal["auto", "start", "middle", "end"]  # the instant of a scan that its stamp names; auto: unknown
BEFORE_STAMP: dict[Stamped, float] = {"auto": 0.0, "start": 0.0, "middle": 0.5, "end": 1.0}  # share of a scan
# Ouster: t; Velodyne: time; Hesai, RoboSense, Livox: timestamp; Livox: offset_time; others' spellings of these
TIME_FIELDS = (
    "t", "time", "timestamp", "offset_time", "time_stamp", "timestamps", "time_offset", "gps_time", "point_time_offset",
)  # fmt: skip
_UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # seconds, ms, us, ns
_TURN = 0.1  # s: what most LiDARs need for a scan
_LONGEST = 2.0  # s: no scan takes longer
_SINCE_1973 = 1e8  # s: a larger time is one of a clock


def time_field(names: list[str] | tuple[str, ...]) -> str | None:
    """The name of the time field among a point's fields; None if there is none."""
    by_name = {name.lower(): name for name in reversed(names)}
    if "s" in by_name:  # s and t are a texture's coordinates
        by_name.pop("t", None)
    return next((by_name[known] for known in TIME_FIELDS if known in by_name), None)


def seconds_after(values: NDArray[np.generic], stamp_ns: int, stamped: Stamped = "start") -> Floats | None:
    """Converts times (N,) in any unit and from any origin to seconds (N,) after the scan's stamp.

    Returns None if they carry no information: all equal, not finite, or no unit gives a plausible scan. The unit is the
    one in which the scan's duration is closest to a turn of 0.1 s; integers are never seconds. Times of a clock (after
    1973 in that unit) are taken relative to the stamp, or, if both clocks differ by more than a scan's duration, to the
    first point. Times with another origin (such as power-on, or the GPS week) are taken relative to the first point
    too. Where times count from the first point, the instant that the scan's stamp names tells how long before the stamp
    that was; times before the stamp show that they do not.
    """
    if values.ndim != 1 or values.dtype.kind not in "fiu" or not len(values):
        return None
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        return None
    first = values.min()
    # whole numbers are subtracted as such: ns since 1970 do not fit a float
    span_of = (values - first).astype(np.float64)
    length = float(span_of.max())
    units = _UNITS if values.dtype.kind == "f" else _UNITS[1:]
    fitting = [unit for unit in units if 0.0 < length * unit <= _LONGEST]
    if not fitting:
        return None
    unit = min(fitting, key=lambda u: abs(np.log(length * u / _TURN)))
    begin = float(first) * unit
    if abs(begin) <= _LONGEST:
        return span_of * unit + begin - (BEFORE_STAMP[stamped] * (length * unit + begin) if begin >= 0 else 0.0)
    if begin > _SINCE_1973 and abs(begin - stamp_ns * 1e-9) <= _LONGEST:
        shift = (int(first) * round(unit * 1e9) - stamp_ns) * 1e-9 if values.dtype.kind != "f" else (
            float(first) * (unit * 1e9) - stamp_ns) * 1e-9  # fmt: skip
        return span_of * unit + shift
    return (span_of - BEFORE_STAMP[stamped] * length) * unit
