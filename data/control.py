"""Control points: surveyed places that the sensor stood at, or saw."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.common.errors import UserError, refusing
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
    """The points of a CSV file whose first line names the columns; map coordinates need the plan's `georeference`.

    Without `sensor_x`, `sensor_y` and `sensor_z` the sensor itself stood at the point. Raises UserError.
    """
    columns, *rows = parsed_lines(path, _FORM, lambda line: [word.strip() for word in line.split(",")])
    known = georeference if {*_MAP} <= {*columns} else None
    if known is None and not {*_PLAN} <= {*columns}:
        lack = "lacks columns" if georeference or not {*_MAP} <= {*columns} else "needs a plan with IfcMapConversion"
        raise UserError(f"{path}: {lack}; give {_FORM}")
    with refusing(f"{path}: not control points", f"give {_FORM}"):
        points = tuple(_point(dict(zip(columns, row, strict=True)), known) for row in rows)
    if not points or len({own.name for own in points}) < len(points):
        raise UserError(f"{path}: {'names a point twice' if points else 'has no points'}; give {_FORM}")
    return points


def _point(row: dict[str, str], georeference: Georeference | None) -> ControlPoint:
    """Raises KeyError and ValueError for what is missing or no number."""

    def numbers(names: tuple[str, str, str]) -> Xyz:
        x, y, z = (float(row[name]) for name in names)
        return x, y, z

    place = numbers(_PLAN if georeference is None else _MAP)
    if georeference is not None:
        x, y, z = georeference.in_plan(np.array([place]))[0].tolist()
        place = x, y, z
    in_sensor = numbers(_SEEN) if row.get(_SEEN[0]) else ControlPoint.in_sensor
    sigma = float(row.get("sigma") or ControlPoint.sigma)
    stamp_ns = int(row["stamp_ns"]) if row.get("stamp_ns") else seconds_to_ns(row["stamp_s"])
    if not (sigma > 0 and np.isfinite([*place, *in_sensor, sigma]).all()):
        raise ValueError(f"{row['name']} has a number that cannot be")
    return ControlPoint(row["name"], place, stamp_ns, in_sensor, sigma)
