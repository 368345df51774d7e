"""The result of a run (trajectories, S-graph, matches, deviations, metrics) and its output folder."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.plans.bim import IFC_SUFFIXES
from data.trajectory import Trajectory
from sgslam.backend import HeldFactors
from sgslam.config import Config
from sgslam.mapping import KeyframeClouds
from sgslam.session.checkpoints import write_run
from sgslam.session.soundness.quality import PlaceReport, Quality
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty
from sgslam.types import Health, MapCheck, Relocalisation

# a run needs none of these before its end
if TYPE_CHECKING:
    from data.plans.bodies import PlannedElement
    from matching.result import MatchesFile
    from sgslam.as_built import Assessment, Deviation
    from sgslam.as_built.elements.rays import View
    from sgslam.session.run_state import RunState

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """A finished run, in metres, radians and seconds.

    `anchored` says whether the map is anchored to the plan, `reason` why or why not, in one line. `trajectory` is in
    the BIM frame when `anchored`, and has the anchored scans only: no lost ones, none of submaps that were not
    relocalised, and none whose pose is too uncertain. Otherwise it is `trajectory_map`, which always has all scans, in
    the map frame. `trajectory_odometry` is the odometry alone, in its own frame. `trajectory_live` has the scans of
    `trajectory`, in its frame, with the poses that were estimated when the scans arrived; None without a second pass.
    `T_bim_map` (4, 4) is the map's pose in the BIM frame, None if the run is not anchored. `s_graph` is in the map
    frame; `a_graph` is in the BIM frame, None without a plan. `matches` has the form of matches.json, None if nothing
    was matched. `anchors` is the log of all anchors: what added each, and when and why it changed. `factors` are
    those of the graph, by kind and key. `clouds` are indexed by keyframe number, `k<number>` in the S-graph.
    `first_anchor_s` counts from the first scan. `seconds` is the time of each stage.
    `earlier` are the trajectories of the prior map's runs, in the frame of `trajectory`. `relocalisation` is None
    without a prior map. `tracked` is the number of good, degraded and lost scans; `uncertainty` has a line for each
    scan, and `quality` says whether the map is sound. `advice` has a line for each thing that seems wrong with the
    scans or with what the user stated about them. `plan_file` is the file that the plan was read from, None if it is
    not known; `check` says how an anchored map agrees with walls that were left out and with control points; `given`
    has all poses of another SLAM system whose scans these are, None without one. `slam` is the
    system that made the result, to save its state.
    """

    anchored: bool
    reason: str
    trajectory: Trajectory
    trajectory_map: Trajectory
    trajectory_odometry: Trajectory
    T_bim_map: Floats | None
    s_graph: SceneGraph
    a_graph: SceneGraph | None
    matches: "MatchesFile | None"
    anchors: list[dict[str, Any]]
    factors: HeldFactors
    first_anchor_s: float | None
    keyframes: int
    seconds: dict[str, float]
    config: Config
    clouds: KeyframeClouds
    tracked: dict[Health, int]
    uncertainty: ScanUncertainty
    quality: Quality
    place: PlaceReport | None = None
    earlier: tuple[Trajectory, ...] = ()
    relocalisation: Relocalisation | None = None
    advice: tuple[str, ...] = ()
    trajectory_live: Trajectory | None = None
    plan_file: Path | None = None
    given: Trajectory | None = None
    slam: "RunState | None" = None
    check: MapCheck = field(default_factory=MapCheck)

    @property
    def deviations(self) -> "list[Deviation]":
        """The content of deviations.json; empty if the run is not anchored."""
        return list(self.assessment.deviations)

    @cached_property
    def assessment(self) -> "Assessment":
        """What was found of the planned elements, and what no plan shows; empty if the run is not anchored.

        It is computed when first asked for. The elements are those of `plan_file`, if that is an IFC model, else the
        walls and levels of `a_graph`. Raises UserError for a model that cannot be read any more.
        """
        from sgslam.as_built import AnchoredMap, Assessment, assess

        if self.T_bim_map is None or self.a_graph is None:
            return Assessment()
        run = AnchoredMap(self.s_graph, self.a_graph, self.T_bim_map, self.matches, self._views(self.T_bim_map))
        return assess(run, *self._planned(), self.config.as_built.tolerance, self.config.anchors.sigma_extraction)

    def _views(self, T_bim_map: Floats) -> "list[View]":
        """What the keyframes that have a cloud saw, in the BIM frame."""
        from sgslam.as_built.elements.rays import View

        keyframes, scans = self.s_graph.keyframes, self.uncertainty
        poses = T_bim_map @ xyzquat_to_poses(np.array([keyframe.pose for keyframe in keyframes]))
        stamps = [keyframe.stamp_ns for keyframe in keyframes]
        sigma = scans.sigma[np.clip(np.searchsorted(scans.stamps_ns, stamps), 0, len(scans.stamps_ns) - 1)]
        heading = np.nan_to_num(sigma[:, 5], nan=np.inf)
        views = []
        for keyframe, T, own, turn in zip(keyframes, poses, sigma[:, :3], heading, strict=True):
            points = self.clouds[int(keyframe.id[1:])]
            if len(points) and np.isfinite(own).all():
                views.append(View(points, T, own, float(turn)))
        return views

    def _planned(self) -> "tuple[Sequence[PlannedElement], Floats]":
        """The elements of the plan, and the bodies (M, 3, 3) of what else it shows."""
        if self.plan_file is not None and self.plan_file.suffix.lower() in IFC_SUFFIXES:
            from data.plans.elements import other_bodies, planned_elements  # loads ifcopenshell

            return planned_elements(self.plan_file), other_bodies(self.plan_file)
        from data.plans.bodies import bodies_of, gaps_of

        assert self.a_graph is not None
        return bodies_of(self.a_graph), gaps_of(self.a_graph)

    def save(self, out: Path | str) -> None:
        """Writes the folder of a run, but its log. Raises UserError if it cannot be written to or the disk is full.

        Of an anchored run, that includes what was found of the planned elements.
        """
        from sgslam.result.saving import prepare_folder, save_result

        out = prepare_folder(Path(out))
        save_result(self, out)
        if self.slam is not None:
            write_run(out, {"finished": True}, self.slam.state())

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json, without the fields that the command line adds."""
        T, known = self.T_bim_map, None if self.a_graph is None else self.a_graph.georeference
        return {
            "anchored": self.anchored,
            "reason": self.reason,
            "anchored_share": float(self.uncertainty.anchored.mean()),
            "quality": {name: asdict(signal) for name, signal in self.quality.items()},
            "place": None if self.place is None else self.place.to_dict(),
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
            **self.check.to_dict(),
            "georeference": None if known is None else asdict(known),
            "scans": len(self.trajectory_map),
            "scans_skipped": 0,
            "tracked": dict(self.tracked),
            "keyframes": self.keyframes,
            "floors": len(self.s_graph.floors),
            "rooms": len(self.s_graph.rooms),
            "wall_surfaces": len(self.s_graph.wall_surfaces),
            "first_anchor_s": self.first_anchor_s,
            "seconds": self.seconds,
            "runs": len(self.earlier) + 1,
            "returned": None if self.relocalisation is None else asdict(self.relocalisation),
            "advice": list(self.advice),
        }
