"""The findings of a run as BCF topics, for BIM viewers."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.ifc.bcf import Model, Topic, Version, write_bcf
from data.scene_graph import SceneGraph
from sgslam.as_built.elements.tolerance_classes import is_off
from sgslam.config.sensor import CARRIER

Floats = NDArray[np.float64]
Entry = Mapping[str, Any]  # of elements.json
BCF: dict[Version, str] = {"2.1": "deviations.bcf", "3.0": "deviations_3.0.bcf"}  # most viewers read the first only
_COLORS = {"moved": "FFD65E00", "absent": "FF56B4E9", "extra": "FFCC79A7"}


def write_topics(
    out: Path, elements: Sequence[Entry], unplanned: Sequence[Entry], a_graph: SceneGraph, model: Model
) -> int:
    """Writes a BCF topic for each element that is absent or off by more than two sigma, and each unplanned wall, to the
    folder `out`, as BCF 2.1 and 3.0; returns the number of topics."""
    topics = [_of_element(own, a_graph) for own in elements if _deviates(own)]
    topics += [_of_unplanned(own) for own in unplanned if own["kind"] == "wall-like"]
    now = datetime.now(UTC)
    for version, name in BCF.items():
        write_bcf(out / name, topics, model, now, version)
    return len(topics)


def _deviates(own: Entry) -> bool:
    return bool(own["verdict"] == "absent") or is_off(own["verdict"], own["offset_m"] or 0.0, own["sigma_m"] or 0.0)


def remove_topics(out: Path) -> None:
    """Deletes the topics that an earlier run left in the folder `out`."""
    for name in BCF.values():
        (out / name).unlink(missing_ok=True)


def _of_element(own: Entry, a_graph: SceneGraph) -> Topic:
    kind, verdict = own["ifc_class"].removeprefix("Ifc").removesuffix("StandardCase"), own["verdict"]
    title = f"{kind} is absent" if verdict == "absent" else f"{kind} is off by {abs(own['offset_m']) * 100:.1f} cm"
    status = ", ".join(filter(None, (own["progress"], own["tolerance"] and f"tolerance: {own['tolerance']}")))
    seen = f"{100 * own['coverage']:.0f} % of it seen"
    said = [*([", ".join(own["rooms"])] if own["rooms"] else []), status, seen, own["reason"]]
    if verdict == "moved":
        turned = "" if own["turn_rad"] is None else f", turned by {np.degrees(own['turn_rad']):.2f} degrees"
        said.append(f"sigma {own['sigma_m'] * 1000:.0f} mm{turned}")
    floors = {name: floor.elevation for floor in a_graph.floors for name in (floor.id, floor.name)}
    first, last, across = _middle_line(np.array(own["outline"], dtype=float).reshape(-1, 2))
    z = (floors.get(own["storey"]) or 0.0) + CARRIER.eye
    if own["direction"] is not None and np.hypot(*own["direction"][:2]) > 0:
        across = np.array(own["direction"][:2]) * np.sign(own["offset_m"] or 1.0)
    ends, facing = ((*first, z), (*last, z)), (float(across[0]), float(across[1]))
    return Topic(title, "; ".join(said), verdict, (own["global_id"],), _COLORS[verdict], ends, facing)


def _middle_line(outline: Floats) -> tuple[tuple[float, float], tuple[float, float], Floats]:
    """The ends of a rectangle's longer axis, and a unit vector across it."""
    if len(outline) < 4:
        first, last = (outline[0], outline[-1]) if len(outline) else (np.zeros(2), np.zeros(2))
    else:
        sides = np.linalg.norm(np.diff(outline[:3], axis=0), axis=1)
        a, b, c, d = np.roll(outline[:4], 0 if sides[0] < sides[1] else 1, axis=0)
        first, last = (a + b) / 2, (c + d) / 2
    along = (last - first) / max(float(np.linalg.norm(last - first)), 1e-9)
    (ax, ay), (bx, by) = first.tolist(), last.tolist()
    return (ax, ay), (bx, by), np.array([-along[1], along[0]])


def _of_unplanned(wall: Entry) -> Topic:
    (ax, ay), (bx, by) = wall["trace"]
    low, high = wall["height_m"]
    where = f"{wall['room']}: " if wall["room"] else ""
    said = f"{where}{wall['length_m']:.1f} m; {wall['reason']}"
    x, y = wall["facing"]
    return Topic(
        "Wall is not in the plan", said, "extra", (), _COLORS["extra"], ((ax, ay, low), (bx, by, high)), (x, y)
    )
