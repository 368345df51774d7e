"""Assembles the result of a run from its final map."""

import logging
from collections import Counter
from typing import TYPE_CHECKING, cast, get_args

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring import BuildingAnchoring, WallAlignment
from sgslam.as_built import Deviation, measured_pieces
from sgslam.as_built.deviation_list import deviations
from sgslam.backend import Backend, Uncertainty
from sgslam.config import Config
from sgslam.mapping import Floors
from sgslam.registration import Health
from sgslam.report.number_formats import NO_PLAN
from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap
from sgslam.session.quality import quality_of
from sgslam.session.result import PoseCovariances, Relocalisation, Result
from sgslam.session.scan_poses import ScanPose, at_stamps, odometry_begins, smooth, with_unplaced
from sgslam.session.scan_uncertainty import ScanUncertainty, scan_uncertainty, why_none_is_anchored
from sgslam.session.unit_advice import feet_advice

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_COVARIANCES = 50  # poses whose covariance is computed


def assemble_result(
    final: ActiveMap, bim: SceneGraph | None, unplaced: list[PriorMap], relocalisation: Relocalisation | None,
    config: Config, advice: list[str], passed_again: bool,
) -> Result:  # fmt: skip
    """The result of a run whose map is `final`; `advice` are lines of the tracker. `passed_again`: all scans were
    registered a second time.

    `unplaced` are the submaps that could not be relocalised: each is laid at the last known pose of the sensor, in the
    map's trajectory only. A pose in a prior map does not count as anchored to the building.
    """
    scans, backend, floors = final.scans, final.backend, final.floors
    anchoring = None if final.plan_is_prior else final.anchoring
    runs = [slice(a, b) for a, b in zip(final.begins, [*final.begins[1:], len(scans)], strict=True)]
    poses, newest = smooth(scans, backend.poses), runs[-1]
    *earlier, placed = [at_stamps(scans[run], poses[run]) for run in runs]
    trajectory_map = with_unplaced(placed, [(part.scans, part.backend.poses) for part in unplaced])
    of_run = sorted([*scans[newest], *(s for part in unplaced for s in part.scans)], key=lambda s: s.stamp_ns)
    T_bim_map = None
    if anchoring is not None and backend.T_map_bim is not None:
        T_bim_map = anchoring.bim_from_map(backend.T_map_bim)
    own = _own(final, newest, T_bim_map, config)
    reason = NO_PLAN if anchoring is None else anchoring.reason
    if T_bim_map is not None and not own.anchored.any():
        T_bim_map, reason = None, why_none_is_anchored(own, config.quality)
        own = _own(final, newest, None, config)
    alignments = anchoring.alignments(floors, backend.T_map_bim) if anchoring is not None else {}
    uncertainty = backend.uncertainty() if T_bim_map is not None else None
    told = ScanUncertainty.joined([own, *_apart(unplaced, config)])
    tracked = {health: sum(scan.health == health for scan in of_run) for health in get_args(Health)}
    odometry = at_stamps(scans[newest], np.stack([s.T_odom_sensor for s in scans[newest]]))
    unit = feet_advice(floors, trajectory_map, bim) if T_bim_map is None else None  # what fits the plan is in metres
    if unit is not None:
        _log.warning("%s", unit)
    first_ns, begin_ns = final.first_anchor_ns, scans[newest.start].stamp_ns
    return Result(
        anchored=T_bim_map is not None,
        reason=reason,
        trajectory=trajectory_map if T_bim_map is None else trajectory_map.only(told.anchored).transformed(T_bim_map),
        trajectory_map=trajectory_map,
        trajectory_odometry=at_stamps(of_run, np.stack([s.T_odom_sensor for s in of_run])),
        T_bim_map=T_bim_map,
        s_graph=floors.graph(backend.keyframes, [floor.scene for floor in floors.maps if floor.scene is not None]),
        a_graph=bim,
        matches=cast("MatchesFile | None", anchoring.answer(floors, alignments) if anchoring is not None else None),
        deviations=_deviations(anchoring, alignments, floors, backend, uncertainty, config),
        anchors=[record.to_dict() for record in anchoring.records] if anchoring is not None else [],
        factors=backend.log,
        pose_covariances=_covariances(backend, uncertainty, T_bim_map, placed, newest.start),
        first_anchor_s=(first_ns - begin_ns) / 1e9 if T_bim_map is not None and first_ns is not None else None,
        keyframes=len(backend.keyframes),
        seconds=dict(final.stopwatch.seconds),
        config=config,
        clouds=final.clouds,
        uncertainty=told,
        quality=quality_of(
            placed, odometry, odometry_begins(scans[newest]), _walls_seen(floors, backend), own,
            tracked["lost"] / len(of_run), sum(len(part.scans) for part in unplaced) / len(of_run), T_bim_map, bim,
            config.quality,
        ),
        tracked=tracked,
        earlier=tuple(run if T_bim_map is None else run.transformed(T_bim_map) for run in earlier),
        relocalisation=relocalisation,
        trajectory_live=_live(scans[newest], told, T_bim_map) if passed_again else None,
        advice=tuple(dict.fromkeys(line for line in (*advice, unit) if line is not None)),
    )


def _live(scans: list[ScanPose], told: ScanUncertainty, T_bim_map: Floats | None) -> Trajectory:
    """The scans' poses in the map as they were estimated when each came; of an anchored run, in the BIM frame."""
    live = at_stamps(scans, np.stack([scan.T_map_sensor for scan in scans]))
    return live if T_bim_map is None else live.only(told.anchored).transformed(T_bim_map)


def _own(final: ActiveMap, run: slice, T_bim_map: Floats | None, config: Config) -> ScanUncertainty:
    """The lines of the map's own scans, in the frame of the building where T_bim_map (4, 4) is known."""
    R_frame_map = np.eye(3) if T_bim_map is None else T_bim_map[:3, :3]
    return scan_uncertainty(final.scans, run, final.backend, R_frame_map, config, 0, T_bim_map is not None)


def _apart(unplaced: list[PriorMap], config: Config) -> list[ScanUncertainty]:
    """The scans of the submaps that were not relocalised, each in its own frame."""
    return [
        scan_uncertainty(part.scans, slice(None), part.backend, np.eye(3), config, number, False)
        for number, part in enumerate(unplaced, 1)
    ]


def _walls_seen(floors: Floors, backend: Backend) -> list[int]:
    """The number of walls that each keyframe sees."""
    seen = Counter(sight.keyframe for floor in floors.maps for sight in floor.walls.seen)
    return [seen[k] for k in range(len(backend.keyframes))]


def _deviations(
    anchoring: BuildingAnchoring | None, alignments: dict[int, WallAlignment], floors: Floors, backend: Backend,
    uncertainty: Uncertainty | None, config: Config,
) -> list[Deviation]:  # fmt: skip
    """The content of deviations.json, storey by storey; empty if the run is not anchored."""
    found: list[Deviation] = []
    if anchoring is None or uncertainty is None:
        return found
    for floor in floors.maps:
        alignment, scene, own = alignments.get(floor.number), floor.scene, anchoring.of(floor.number)
        if alignment is None or scene is None:
            continue
        pieces = measured_pieces(alignment, scene, floor.walls, uncertainty, anchoring.origin, own.height, config)
        keyframes = [k for k in backend.keyframes if k.storey == floor.number]
        found += deviations(
            pieces, alignment, scene, floor.walls, keyframes, own.storey, anchoring.origin[:2], config
        )  # fmt: skip
    return found


def _covariances(
    backend: Backend, uncertainty: Uncertainty | None, T_bim_map: Floats | None, in_map: Trajectory, begin: int
) -> PoseCovariances | None:
    if uncertainty is None or T_bim_map is None:
        return None
    own = [i for i, keyframe in enumerate(backend.keyframes) if keyframe.scan >= begin]
    places = np.unique(np.linspace(0, len(own) - 1, min(len(own), _COVARIANCES)).astype(int))
    chosen = np.array(own)[places]
    scans = np.searchsorted(in_map.stamps_ns, [backend.keyframes[i].stamp_ns for i in chosen])
    covariances = uncertainty.pose_covariances(chosen.tolist())
    order = np.argsort(scans)
    return PoseCovariances(
        Trajectory(in_map.stamps_ns[scans[order]], T_bim_map @ in_map.poses[scans[order]]), covariances[order]
    )
