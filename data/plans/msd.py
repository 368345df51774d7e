"""Modified Swiss Dwellings as published: a table of polygons (CSV, WKT in metres), read apartment by apartment.

MSD: van Engelenburg et al., "MSD: A Benchmark Dataset for Floor Plan Generation of Building Complexes", ECCV 2024.
Both published tables (`MSD 5.664k (V1).csv`, `mds_V2_5.372k.csv`) and the table that they were made from (Swiss
Dwellings' `geometries.csv`) have the columns that are read here; others are ignored.
"""

import csv
import logging
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import shapely

from data.common.errors import UserError
from data.geometry.areas import Area, polygons_of, united
from data.plans.polygons import Drawing, DrawnRoom, Plan, scene_graph_of
from data.plans.polygons_json import MIN_AREA, is_room
from data.scene_graph import Floor

GEOMETRY = ("geom", "geometry")
BUILDING = ("site_id", "building_id", "plan_id", "floor_id")  # a site's buildings are often alike: they stay together
NO_AREA = ("structure", "door", "entrance door", "window", "wall", "railing", "column")
_log = logging.getLogger(__name__)
LARGEST_FIELD = 10_000_000  # characters


@dataclass
class Index:
    """Where the rows of each plan begin in the file (bytes), and the doors and walls of each floor."""

    header: list[str]
    plans: dict[str, array] = field(default_factory=dict)
    fixed: dict[str, array] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)


def read_msd(path: Path, merge_collinear: bool = True) -> Iterator[Plan]:
    """The table's apartments in the order in which they first appear; the rows of a plan may lie anywhere in it.

    The file is scanned once for where each row begins, then each plan's rows are read when needed: this takes a few
    bytes of memory per row. An apartment on several floors has several floors in its graph; ids of floors are
    the table's. `merge_collinear`: see `scene_graph_of`; without it shafts, small rooms and balconies are rooms, as in
    the published matcher's data.

    Rows without a usable polygon and plans without rooms are left out and counted in the log. Raises UserError for a
    file that is not such a table.
    """
    with path.open("rb") as file:
        index = _index(file, path)
        everything, without_rooms = not merge_collinear, 0
        fixed_of: list[str] = []
        fixed: list[dict[str, str]] = []
        for key, starts in index.plans.items():
            rows = [_row(file, start, index.header) for start in starts]
            floors = list(dict.fromkeys(r["floor_id"] for r in rows))
            if floors != fixed_of:  # neighbours in the table share their floor
                fixed = [_row(file, s, index.header) for f in floors for s in index.fixed.get(f, ())]
                fixed_of = floors
            drawing = _drawing(rows, fixed, everything, index.skipped)
            graph = scene_graph_of(drawing, merge_collinear)
            if not graph.wall_surfaces:
                without_rooms += 1
                continue
            building = next((f"{c[:-3]} {_id(rows[0][c])}" for c in BUILDING if rows[0].get(c)), key)
            yield Plan(f"apartment {key}", building, graph)
    if without_rooms:
        _log.warning(f"{path}: skipped {without_rooms} of {len(index.plans)} plans: no room with walls")
    for reason, count in index.skipped.items():
        _log.warning(f"{path}: skipped {count} rows: {reason}")


def _index(file: BinaryIO, path: Path) -> Index:
    """One pass over the table."""
    csv.field_size_limit(LARGEST_FIELD)
    starts = _Starts(file)
    reader = csv.reader(starts)
    try:
        header = next(reader, [])
        column = {name: k for k, name in enumerate(header)}
        lacking = [c for c in ("floor_id", "apartment_id", "roomtype") if c not in column]
        if lacking or not any(c in column for c in GEOMETRY):
            raise UserError(f"{path}: not Modified Swiss Dwellings: no column {', '.join(lacking) or GEOMETRY[0]}")
        index = Index(header)
        key = column["apartment_id"]
        start = starts.next_row()
        for row in reader:
            here, start = start, starts.next_row()
            if len(row) != len(header):
                index.skipped["not as many columns as the header has"] += bool(row)
            elif row[column["roomtype"]].strip().lower() in NO_AREA:
                index.fixed.setdefault(row[column["floor_id"]], array("q")).append(here)
            elif row[key] and row[column["floor_id"]]:
                index.plans.setdefault(_id(row[key]), array("q")).append(here)
    except (csv.Error, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not a CSV table in UTF-8 ({error})") from None
    return index


class _Starts:
    """A binary file's lines as text; records where the next line begins."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._position = file, 0

    def __iter__(self) -> "_Starts":
        return self

    def __next__(self) -> str:
        line = self._file.readline()
        if not line:
            raise StopIteration
        self._position += len(line)
        return line.decode("utf-8-sig" if self._position == len(line) else "utf-8")

    def next_row(self) -> int:
        return self._position


def _row(file: BinaryIO, start: int, header: list[str]) -> dict[str, str]:
    file.seek(start)
    reader = csv.reader(line.decode() for line in file)
    return dict(zip(header, next(reader), strict=True))


def _id(value: str) -> str:
    """Ids without the `.0` that a table with gaps adds to integers."""
    return value[:-2] if value.endswith(".0") else value


def _drawing(
    rows: list[dict[str, str]], fixed: list[dict[str, str]], everything: bool, skipped: Counter[str]
) -> Drawing:
    rooms: list[DrawnRoom] = []
    floors: dict[str, Floor] = {}
    for k, row in enumerate(rows):
        kind, floor = row["roomtype"].strip(), _id(row["floor_id"])
        known = [row.get("entity_subtype", ""), kind]
        if row.get("entity_type", "area") not in ("area", "") or not all(
            is_room(word, outside=everything) for word in known
        ):
            continue
        low, tall = _number(row.get("elevation")), _number(row.get("height"))
        height = (low, low + tall) if low is not None and tall else None
        for n, part in enumerate(_polygons(row, skipped)):
            if everything or part.area >= MIN_AREA:
                rooms.append(DrawnRoom(f"room{k}" + (f".{n}" if n else ""), part, kind, floor, height))
                floors.setdefault(floor, Floor(floor, f"Floor {floor}", low))
    doors, walls = [], []
    around = shapely.MultiPolygon([r.area for r in rooms]).envelope.buffer(1.0)
    for k, row in enumerate(fixed):
        parts = [p for p in _polygons(row, skipped) if p.intersects(around)]
        if "door" in row["roomtype"].lower():
            doors += [(f"door{k}", part, _id(row["floor_id"])) for part in parts]
        else:
            walls += parts
    return Drawing(rooms, doors, united(walls), tuple(floors.values()))


def _polygons(row: dict[str, str], skipped: Counter[str]) -> list[Area]:
    text = next(row[c] for c in GEOMETRY if c in row)
    try:
        shape = shapely.from_wkt(text)
    except (shapely.errors.ShapelyError, TypeError):
        skipped["the polygon is not WKT"] += 1
        return []
    area = polygons_of(shape) if shape is not None and np.isfinite(shape.bounds).all() else shapely.Polygon()
    if area.is_empty:
        skipped["no area, or numbers that are not finite"] += 1
    return [p for p in shapely.get_parts(area) if p.area > 0]


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "nan")
    except ValueError:
        return None
    return value if np.isfinite(value) else None
