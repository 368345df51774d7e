"""Control points: surveyed places that the sensor stood at, or saw."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.common.files import parsed_lines
from data.scene_graph import Georeference
from data.trajectory.stamps import seconds_to_ns

Xyz = tuple[float, float, float]
_PLAN, _MAP = ("x", "y", "z"), ("easting", "northing", "height")
_SEEN = ("sensor_x", "sensor_y", "sensor_z")
_FORM = (
    "a CSV file with the columns name, x, y, z (m, in the plan) or easting, northing, height (on the map), stamp_s or "
    "stamp_ns, and, if you like, sigma (m) and sensor_x, sensor_y, sensor_z (m)"
)


@dataclass(frozen=True)
class ControlPoint:
    """`place` is in the BIM frame; at the stamp the point is at `in_sensor` in the sensor's frame, in metres. `sigma`
    (m) is the standard deviation of each coordinate."""

    name: str
    place: Xyz
    stamp_ns: int
    in_sensor: Xyz = (0.0, 0.0, 0.0)
    sigma: float = 0.01


def read_control(path: Path, georeference: Georeference | None) -> tuple[ControlPoint, ...]:
    """The points of a CSV file, whose first line names the columns. Map coordinates need the plan's `georeference`.

    Without `sensor_x`, `sensor_y` and `sensor_z` the sensor itself stood at the point. Raises UserError, with the
    line's number.
    """
    columns = list[str]()

    def point(line: str) -> ControlPoint | None:
        words = [word.strip() for word in line.split(",")]
        if not columns:
            columns.extend(words)
            if "name" not in words or not {"stamp_s", "stamp_ns"} & {*words} or not ({*_PLAN} <= {*words} or on_map()):
                raise ValueError("columns are missing")
            return None
        if len(words) != len(columns):
            raise ValueError(f"{len(words)} values for {len(columns)} columns")
        row = dict(zip(columns, words, strict=True))
        stamp_ns = int(row["stamp_ns"]) if row.get("stamp_ns") else seconds_to_ns(row.get("stamp_s", ""))
        place, sigma = _numbers(row, _MAP if on_map() else _PLAN), float(row.get("sigma") or ControlPoint.sigma)
        if not 0 < sigma < np.inf:
            raise ValueError(f"a sigma of {sigma:g} m")
        if on_map() and georeference is not None:
            x, y, z = georeference.in_plan(np.array([place]))[0].tolist()
            place = x, y, z
        is_seen = any(row.get(name) for name in _SEEN)
        return ControlPoint(row["name"], place, stamp_ns, _numbers(row, _SEEN) if is_seen else (0.0, 0.0, 0.0), sigma)

    def on_map() -> bool:
        return {*_MAP} <= {*columns}

    points = [own for own in parsed_lines(path, _FORM, point) if own is not None]
    if not points:
        raise UserError(f"{path}: has no points; give {_FORM}")
    if on_map() and georeference is None:
        raise UserError(
            f"{path}: is in map coordinates, but the plan has no IfcMapConversion; give x, y, z in the plan"
        )
    if len({own.name for own in points}) < len(points):
        raise UserError(f"{path}: names a point twice; names must be unique")
    return tuple(points)


def _numbers(row: dict[str, str], names: tuple[str, ...]) -> Xyz:
    x, y, z = (float(row[name]) for name in names)
    if not np.isfinite([x, y, z]).all():
        raise ValueError("a coordinate is not finite")
    return x, y, z
