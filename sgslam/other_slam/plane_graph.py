"""Anchors a factor graph of S-Graphs without clouds: its planes are matched with the plan and held to it."""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import poses_to_xyzquat
from data.plans import load_bim
from data.scene_graph import SceneGraph
from data.scene_graph.g2o import PlaneGraph, plane_of, read_g2o
from matching import Matcher, MatchResult
from sgslam.anchoring import check_storey
from sgslam.anchoring.storey_hypotheses import floor_named
from sgslam.backend import anchor_plane_graph
from sgslam.cli.job.arguments import out_folder, three_numbers
from sgslam.config.loading import load_config
from sgslam.geometry.frames import se2_to_se3

Floats = NDArray[np.float64]
KEYFRAMES = "keyframes.txt"
NOT_ANCHORED = 3  # exit code, with --strict
_WITHOUT_USE = ("cloud", "times", "topic", "map", "ground_truth", "mount", "tolerance", "view")


@dataclass(frozen=True, eq=False)
class Anchored:
    """Keyframes as T_bim_sensor (4, 4) by their ids, and the median distance (m) of matched walls from their plan."""

    keyframes: dict[int, Floats]
    wall_distance: float


def anchor_file(options: argparse.Namespace) -> int:
    """Anchors the graph of `options.slam_output` and writes what came of it; returns the exit code.

    Raises UserError for a damaged file, an unknown storey, and options that have no use without clouds.
    """
    for name in _WITHOUT_USE:
        if getattr(options, name) is not None:
            option = f"--{name.replace('_', '-')}"
            raise UserError(f"{option}: has no effect without clouds; leave it out, or give --scans")
    start = None if options.start is None else three_numbers("--start", options.start, "X,Y,YAW", "3.5,-1.2,1.57")
    method = load_config(options.config, options.set).matching.method
    graph, plan = read_g2o(options.slam_output), load_bim(options.bim, layers=options.layer).graph
    check_storey(plan, options.storey)
    floor = None if options.storey is None else floor_named(plan, options.storey).id
    out, s_graph = out_folder(options), graph.scene_graph()
    placed = None if start is None else (start[2], start[0], start[1])  # the yaw first
    match = Matcher.load(method).match(s_graph, plan, floor=floor, start=placed)
    anchored = anchor_matched(graph, plan, match)
    _write(out, s_graph, plan, match, anchored)
    for line in graph.refused:
        print(f"left out, {line}")
    print(f"{match.status}: {match.reason}")
    if anchored is not None:
        print(f"{len(anchored.keyframes)} keyframes anchored; walls {anchored.wall_distance:.3f} m from their plan")
        print(f"poses: {out / KEYFRAMES}")
    if not options.strict or anchored is not None:
        return 0
    print(f"--strict: exit code {NOT_ANCHORED}: not anchored", file=sys.stderr)
    return NOT_ANCHORED


def anchor_matched(graph: PlaneGraph, plan: SceneGraph, match: MatchResult) -> Anchored | None:
    """The graph anchored where it was matched; None where the match is not unique."""
    if match.status != "unique" or match.T_a_s is None:
        return None
    pairs = [(plane_of(s_id), plan.surface_by_id[a_id]) for s_id, a_id, _ in match.wall_surfaces]
    found = anchor_plane_graph(graph, pairs, se2_to_se3(*match.T_a_s))
    distances = [
        abs(found.planes[plane] @ [*wall.centroid, 0.0, 1.0]) for plane, wall in pairs if plane in found.planes
    ]
    raised = np.eye(4)
    raised[2, 3] = _elevation(plan, match.floor)
    keyframes = {number: raised @ pose for number, pose in found.keyframes.items()}
    return Anchored(keyframes, float(np.median(distances)))


def _elevation(plan: SceneGraph, floor: str | None) -> float:
    """The height (m) of a floor of the plan; 0 where it is unknown."""
    known = [own.elevation for own in plan.floors if own.elevation is not None and floor in (None, own.id)]
    return float(known[0]) if len(known) == 1 else 0.0


def _write(out: Path, s_graph: SceneGraph, plan: SceneGraph, match: MatchResult, anchored: Anchored | None) -> None:
    s_graph.save(out / "s_graph.json")
    plan.save(out / "a_graph.json")
    write_json(out / "matches.json", match.to_dict())
    metrics: dict[str, Any] = {"anchored": anchored is not None, "reason": match.reason}
    if anchored is None:
        (out / KEYFRAMES).unlink(missing_ok=True)  # that of an earlier call
    else:
        metrics |= {"keyframes": len(anchored.keyframes), "wall_distance_m": round(anchored.wall_distance, 4)}
        lines = ["# id x y z qx qy qz qw, in the BIM frame"]
        for number, pose in anchored.keyframes.items():
            lines.append(" ".join([str(number), *(f"{value:.9g}" for value in poses_to_xyzquat(pose).tolist())]))
        write_atomically(out / KEYFRAMES, "\n".join(lines) + "\n")
    write_json(out / "metrics.json", metrics)
