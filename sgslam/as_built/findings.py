"""The findings of a run by element, in formats for BIM viewers."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.ifc.bcf import Model, Topic, Version, write_bcf
from data.scene_graph import SceneGraph, WallSurface
from sgslam.as_built.elements import UnplannedEntry

if TYPE_CHECKING:
    from data.ifc.deviations import ElementFinding, Status, UnplannedWall

Floats = NDArray[np.float64]
Deviation = Mapping[str, Any]  # an entry of deviations.json
BCF: dict[Version, str] = {"2.1": "deviations.bcf", "3.0": "deviations_3.0.bcf"}  # most viewers read the first only
_COLORS = {"moved": "FFD65E00", "absent": "FF56B4E9", "extra": "FFCC79A7"}
_HEIGHT = 2.5  # m of a wall whose height is not known


def by_wall(deviations: Sequence[Deviation]) -> dict[str, list[Deviation]]:
    """The entries of each planned wall by its source, in their order; extra walls are none."""
    found: dict[str, list[Deviation]] = defaultdict(list)
    for deviation in deviations:
        if deviation["source"] and deviation["kind"] != "extra":
            found[deviation["source"]].append(deviation)
    return dict(found)


def wall_status(entries: list[Deviation], tolerance: float) -> tuple["Status", Deviation]:
    """The status of a wall by its entries, and the entry that decides it, that of the least sigma among several.

    `tolerance` (m) is the largest offset that counts as planned.
    """
    moved = [d for d in entries if d["kind"] == "moved"]
    significant = [d for d in moved if d["significant"]]
    if significant:
        return "moved", min(significant, key=lambda d: d["sigma_m"])
    absent = [d for d in entries if d["kind"] == "absent"]
    if absent:
        return "absent", absent[0]
    standing = [d for d in moved if abs(d["offset_m"]) <= max(tolerance, 3 * d["sigma_m"])]
    if standing:
        return "as planned", min(standing, key=lambda d: d["sigma_m"])
    return "uncertain", min(moved, key=lambda d: d["sigma_m"])


def wall_findings(deviations: Sequence[Deviation], a_graph: SceneGraph, tolerance: float) -> list["ElementFinding"]:
    """The finding for each planned wall with entries, of a run that has no verdicts on elements."""
    from data.ifc.deviations import ElementFinding

    findings = []
    for source, entries in by_wall(deviations).items():
        status, d = wall_status(entries, tolerance)
        shift = None
        if d["offset_m"] is not None:
            nx, ny = a_graph.surface_by_id[d["a_id"]].normal
            shift = (d["offset_m"] * nx, d["offset_m"] * ny, 0.0)
        findings.append(ElementFinding(source, status, shift, d["sigma_m"], d["tilt_rad"], d.get("reason", "")))
    return findings


def element_findings(elements: Sequence[Mapping[str, Any]]) -> list["ElementFinding"]:
    """The finding for each entry of elements.json."""
    from data.ifc.deviations import ElementFinding, Measurement

    findings = []
    for told in elements:
        shift = None
        if told["offset_m"] is not None:
            x, y, z = (told["offset_m"] * axis for axis in told["direction"])
            shift = (x, y, z)
        measurement = Measurement(told["loa"], told["conclusive"], told["seen"], told["views"])
        findings.append(ElementFinding(
            told["global_id"], told["verdict"], shift, told["sigma_m"], told["turn_rad"], told["reason"], measurement,
        ))  # fmt: skip
    return findings


def unplanned_findings(walls: Sequence[UnplannedEntry], a_graph: SceneGraph) -> list["UnplannedWall"]:
    """The finding for each wall that no plan shows."""
    from data.ifc.deviations import UnplannedWall

    storeys = {floor.name or floor.id: floor.id for floor in a_graph.floors}
    return [
        UnplannedWall(wall.id, *wall.trace, *wall.height_m, storeys.get(wall.storey), wall.reason) for wall in walls
    ]


def write_topics(
    out: Path, deviations: Sequence[Deviation], unplanned: Sequence[UnplannedEntry], a_graph: SceneGraph,
    model: Model, tolerance: float,
) -> int:  # fmt: skip
    """Writes a BCF topic for each moved, missing or unplanned wall to the folder `out`, as BCF 2.1 and 3.0;
    returns the number of topics."""
    topics = []
    for source, entries in by_wall(deviations).items():
        status, d = wall_status(entries, tolerance)
        if status in ("moved", "absent"):
            surface = a_graph.surface_by_id[d["a_id"]]
            room = a_graph.room_by_id.get(surface.room or "")
            title = f"Wall {_off(d)}" if status == "moved" else "Wall is absent"
            where = f"{room.name or room.id}: " if room is not None else ""
            place = _segment(surface, a_graph)
            topics.append(_topic(title, where + _description(d), status, (source,), place, surface.normal))
    for wall in unplanned:
        first, last = ((*end, z) for end, z in zip(wall.trace, wall.height_m, strict=True))
        where = f"{wall.room}: " if wall.room else ""
        said = f"{where}{wall.length_m:.1f} m; {wall.reason}"
        topics.append(_topic("Wall is not in the plan", said, "extra", (), (first, last), wall.facing))
    now = datetime.now(UTC)
    for version, name in BCF.items():
        write_bcf(out / name, topics, model, now, version)
    return len(topics)


def remove_topics(out: Path) -> None:
    """Deletes the topics that an earlier run left in the folder `out`."""
    for name in BCF.values():
        (out / name).unlink(missing_ok=True)


def _topic(
    title: str, description: str, kind: str, ids: tuple[str, ...], segment: tuple[Any, Any],
    towards: tuple[float, float],
) -> Topic:  # fmt: skip
    return Topic(title, description, kind, ids, _COLORS[kind], segment, towards)


def _off(d: Deviation) -> str:
    side = "into the room" if d["offset_m"] > 0 else "back"
    return f"stands {abs(d['offset_m']) * 100:.1f} cm {side}"


def _description(d: Deviation) -> str:
    parts = [str(d.get("reason") or "")]
    if d["sigma_m"] is not None:
        parts.append(f"sigma {d['sigma_m'] * 1000:.0f} mm, turned by {np.degrees(d['tilt_rad']):.2f} degrees")
    return "; ".join(part for part in parts if part)


def _segment(surface: WallSurface, graph: SceneGraph) -> tuple[Any, Any]:
    """The ends of a planned surface at half its height."""
    low, high = surface.height or _heights(surface, graph)
    first, last = surface.ends()
    return (*first, (low + high) / 2), (*last, (low + high) / 2)


def _heights(surface: WallSurface, graph: SceneGraph) -> tuple[float, float]:
    elevation = next((f.elevation for f in graph.floors if f.id == surface.floor), None) or 0.0
    return elevation, elevation + _HEIGHT
