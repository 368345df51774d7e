"""Files of S-graphs built by the SLAM system, with their truth: one for each drive and each building's A-graph."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.common.files import write_json
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import DrawnGraph

SUFFIX = ".s_graphs.json"


@dataclass(frozen=True)
class SlamGraph:
    """The S-graph passed to the matcher `seconds` after the start of a drive; `whole` at its end."""

    seconds: float
    whole: bool
    drawn: DrawnGraph


@dataclass(frozen=True)
class SlamDrive:
    """The S-graphs of one drive in order of time, and the whole building's A-graph."""

    sequence: str
    seed: int
    a_graph: SceneGraph
    graphs: tuple[SlamGraph, ...]


def write_drive(folder: Path, drive: SlamDrive, building: str) -> None:
    """Writes `SEQUENCE-SEED.s_graphs.json`, and `BUILDING.a_graph.json` if it is missing."""
    plan = folder / f"{building}.a_graph.json"
    if not plan.exists():
        drive.a_graph.save(plan)
    graphs = [{"seconds": g.seconds, "whole": g.whole, "drawn": _written(g.drawn)} for g in drive.graphs]
    value = {"sequence": drive.sequence, "seed": drive.seed, "a_graph": plan.name, "graphs": graphs}
    write_json(drive_file(folder, drive.sequence, drive.seed), value)


def drive_file(folder: Path, sequence: str, seed: int) -> Path:
    """The file of a drive's S-graphs."""
    return folder / f"{sequence}-{seed}{SUFFIX}"


def read_drives(folder: Path) -> Iterator[SlamDrive]:
    """All drives of a folder, by name. Raises UserError if there is none or a file cannot be read."""
    files = sorted(folder.glob(f"*{SUFFIX}"))
    if not files:
        raise UserError(f"{folder}: no *{SUFFIX} files; make them with python -m evaluation.drives.slam_graphs")
    plans: dict[str, SceneGraph] = {}
    for file in files:
        try:
            value = json.loads(file.read_text())
            plan = value["a_graph"]
            if plan not in plans:
                plans[plan] = SceneGraph.load(folder / plan)
            graphs = tuple(SlamGraph(g["seconds"], g["whole"], _read(g["drawn"])) for g in value["graphs"])
            yield SlamDrive(value["sequence"], value["seed"], plans[plan], graphs)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(f"{file}: not a drive's S-graphs ({type(error).__name__}); make it again") from None


def _written(drawn: DrawnGraph) -> dict[str, Any]:
    return {**asdict(drawn), "s_graph": drawn.s_graph.to_dict()}


def _read(value: dict[str, Any]) -> DrawnGraph:
    by_room = {room: tuple(T) for room, T in value["T_a_s_by_room"].items()}
    read = {"s_graph": SceneGraph.from_dict(value["s_graph"]), "T_a_s": tuple(value["T_a_s"])}
    return DrawnGraph(**{**value, **read, "T_a_s_by_room": by_room})
