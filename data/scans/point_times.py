"""The times of single points as the drivers of LiDARs write them: under several names, in several units."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Ouster: t; Velodyne: time; Hesai, RoboSense, Livox: timestamp; Livox: offset_time; others' spellings of these
TIME_FIELDS = (
    "t", "time", "timestamp", "offset_time", "time_stamp", "timestamps", "time_offset", "gps_time", "point_time_offset",
)  # fmt: skip
_UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # seconds, ms, us, ns
_TURN = 0.1  # s: what most LiDARs need for a scan
_LONGEST = 2.0  # s: no scan takes longer
_SINCE_1973 = 1e8  # s: a larger time is one of a clock


def time_field(names: list[str] | tuple[str, ...]) -> str | None:
    """The name among a point's fields that is its time's; None where there is none."""
    by_name = {name.lower(): name for name in reversed(names)}
    if "s" in by_name:  # s and t are a texture's coordinates
        by_name.pop("t", None)
    return next((by_name[known] for known in TIME_FIELDS if known in by_name), None)


def seconds_after(values: NDArray[np.generic], stamp_ns: int) -> Floats | None:
    """(N,) seconds after the scan's stamp, of times (N,) in whatever unit, from whatever origin; None where they tell
    nothing (all the same, not finite, or no unit makes a scan of them).

    The unit is the one in which the scan's length is nearest to a turn of 0.1 s; whole numbers are never seconds. Times
    of a clock (after 1973 in that unit) are held against the stamp, and where the two clocks are no scan's length
    from each other, against the first point; times that begin elsewhere, such as since the sensor was
    switched on or of a GPS week, likewise.
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
        return span_of * unit + begin
    if begin > _SINCE_1973 and abs(begin - stamp_ns * 1e-9) <= _LONGEST:
        shift = (int(first) * round(unit * 1e9) - stamp_ns) * 1e-9 if values.dtype.kind != "f" else (
            float(first) * (unit * 1e9) - stamp_ns) * 1e-9  # fmt: skip
        return span_of * unit + shift
    return span_of * unit
