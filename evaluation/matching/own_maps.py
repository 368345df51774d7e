"""The maps that the system itself builds on a simulated drive, with their true matches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.scene_graph.graph import MIRRORED
from data.synthetic_maps.noise_models import DrawnGraph
from evaluation.buildings import plan_graph, storey_of
from evaluation.drive import DriveCase, drive_of
from evaluation.metrics.true_matches import true_matches
from matching import MatchResult
from sgslam.slam import SceneGraphSlam

LEAST_WALLS = 4
NEVER = MatchResult("none", "maps are only recorded")


class Recorder:
    """A matcher that finds no match, so that no map is anchored; `every` are the S-graphs that it was asked about."""

    def __init__(self) -> None:
        self.every: list[SceneGraph] = []

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Keeps the S-graph, but not the mirror image that a run matches too; never a match."""
        if not s.frame.endswith(MIRRORED):
            self.every.append(s)
        return NEVER

    @property
    def maps(self) -> list[SceneGraph]:
        """The first S-graph of each number of rooms, and the last one; those with enough walls, in order of time."""
        first: dict[int, SceneGraph] = {}
        for s in self.every:
            if s.rooms:
                first.setdefault(len(s.rooms), s)
        chosen = [*first.values(), *self.every[-1:]]
        distinct = {id(s): s for s in chosen}.values()
        return [replace(one, keyframes=()) for one in distinct if len(one.wall_surfaces) >= LEAST_WALLS]


def own_maps(case: DriveCase, work: Path) -> tuple[list[DrawnGraph], SceneGraph]:
    """The maps of a drive with their truth, and the whole building's A-graph.

    Raises UserError as the simulator and the run do.
    """
    drive = drive_of(case, work)
    plan, T_bim_map, recorder = plan_graph(drive.bim), drive.truth.poses[0], Recorder()
    slam = SceneGraphSlam(plan, recorder)
    for scan in drive.scans():
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
    slam.finish()
    storey = storey_of(plan, T_bim_map)
    return [_with_truth(s, plan.on_floor(storey), T_bim_map) for s in recorder.maps], plan


def _with_truth(s: SceneGraph, storey: SceneGraph, T_bim_map: NDArray[np.float64]) -> DrawnGraph:
    truth = true_matches(s, storey, T_bim_map)
    by_room = dict.fromkeys(truth.rooms, truth.T_a_s)
    return DrawnGraph(s, truth.rooms, truth.wall_surfaces, truth.T_a_s, by_room, truth.floor, False)
