"""Assembles the result of a run from its final map."""

import logging
from collections import Counter
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring import BuildingAnchoring
from sgslam.anchoring.soundness import shipped
from sgslam.config import Config
from sgslam.result.result import Result
from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap
from sgslam.session.scan_poses import RunPoses, ScanPose, at_stamps, newest_run, odometry_begins, odometry_of
from sgslam.session.soundness.quality import PlaceReport, Quality, at_least, contradiction, placed_signals, quality_of
from sgslam.session.soundness.scan_uncertainty import (
    ScanUncertainty,
    scan_uncertainty,
    what_is_not_anchored,
    why_none_is_anchored,
)
from sgslam.session.soundness.standing_walls import share_looked_through, standing_walls
from sgslam.types import NO_PLAN, MapCheck, Relocalisation

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_HELPS = {  # by the status of an answer of the matcher
    "ambiguous": "to tell these places apart, visit more rooms, name the storey (--storey NAME), or give a rough start "
    "pose (--start X,Y,YAW)",
    "none": "check that this is the model of the scanned building, and --storey and --start if they were given, "
    "or visit more rooms",
}


def assemble_result(
    final: ActiveMap,
    bim: SceneGraph | None,
    unplaced: list[PriorMap],
    relocalisation: Relocalisation | None,
    config: Config,
    advice: list[str],
    passed_again: bool,
    check: MapCheck,
) -> Result:
    """The result of a run whose map is `final`; `advice` are lines of the tracker. `passed_again`: all scans were
    registered a second time. `check` is how well the map agrees with walls that were left out, and control points.

    `unplaced` are the submaps that could not be relocalised: each is laid at the last known pose of the sensor, in the
    map's trajectory only. A pose in a prior map does not count as anchored to the building.
    """
    backend, floors = final.backend, final.floors
    parts = [(part.scans, part.backend.poses) for part in unplaced]
    run = newest_run(final.scans, final.begins, backend.poses, parts)
    anchoring = None if final.plan_is_prior else final.anchoring
    known = backend.uncertainty()
    alignments = anchoring.alignments(floors, backend.T_map_local) if anchoring is not None else {}
    matches = cast("MatchesFile | None", anchoring.answer(floors, alignments) if anchoring is not None else None)
    standing = None
    if bim is not None and anchoring is not None and matches is not None:
        standing = standing_walls(bim, alignments, floors, anchoring.origin)
    T_bim_map, place, reason = final.T_bim_map, None, NO_PLAN
    own = scan_uncertainty(final, run.begin, known, T_bim_map, config)
    quality = _quality(final, run, own, config)
    if anchoring is not None:
        place, refused = _place(anchoring, final, run, own, quality, standing, config)
        reason = refused or anchoring.reason
        if refused is None:
            quality["place_probability"] = at_least(place.probability, config.quality.place_probability)
        elif T_bim_map is not None:
            T_bim_map, own = None, scan_uncertainty(final, run.begin, known, None, config)
            quality = _quality(final, run, own, config)
    apart = [scan_uncertainty(p, 0, p.backend.uncertainty(), None, config, n) for n, p in enumerate(unplaced, 1)]
    states = ScanUncertainty.joined([own, *apart])
    if T_bim_map is None:
        advice = [*advice, *_what_helps(matches, reason)]
        others = int((states.part > 0).sum())
        if others and anchoring is not None:
            reason = f"{reason}; the map has several parts: {others} of {len(states.part)} scans are not in the first"
    elif missing := what_is_not_anchored(states):
        reason = f"{reason}; {missing}"
    check = MapCheck() if T_bim_map is None else check
    advice = [*advice, *_contradictions(check)]
    first_anchor_s = None  # seconds from the run's first scan in the map
    if T_bim_map is not None and final.first_anchor_ns is not None:
        first_anchor_s = (final.first_anchor_ns - int(run.in_map.stamps_ns[0])) / 1e9
    whole = run.with_unplaced
    return Result(
        anchored=T_bim_map is not None,
        reason=reason,
        trajectory=whole if T_bim_map is None else whole.only(states.anchored).transformed(T_bim_map),
        trajectory_map=whole,
        trajectory_odometry=odometry_of(run.all_scans),
        T_bim_map=T_bim_map,
        s_graph=floors.graph(backend.keyframes, [floor.scene for floor in floors.maps if floor.scene is not None]),
        a_graph=bim,
        matches=matches,
        anchors=[record.to_dict() for record in anchoring.records] if anchoring is not None else [],
        factors=backend.held,
        first_anchor_s=first_anchor_s,
        keyframes=len(backend.keyframes),
        seconds=dict(final.stopwatch.seconds),
        config=config,
        clouds=final.clouds,
        uncertainty=states,
        quality=quality,
        place=place,
        tracked=run.tracked,
        earlier=tuple(path if T_bim_map is None else path.transformed(T_bim_map) for path in run.earlier),
        relocalisation=relocalisation,
        trajectory_live=_live(run.scans, states, T_bim_map) if passed_again else None,
        advice=tuple(dict.fromkeys(advice)),
        check=check,
    )


def _place(
    anchoring: BuildingAnchoring,
    final: ActiveMap,
    run: RunPoses,
    own: ScanUncertainty,
    quality: Quality,
    standing: SceneGraph | None,
    config: Config,
) -> tuple[PlaceReport, str | None]:
    """What is believed of the map's place, and why it does not hold: there is none, no scan is known well enough there,
    or the map is probably not sound."""
    T_bim_map = final.T_bim_map
    if T_bim_map is None or standing is None:
        return PlaceReport(anchoring.posterior), anchoring.reason
    keyframes = [k for k, keyframe in enumerate(final.backend.keyframes) if keyframe.scan >= run.begin]
    through = share_looked_through(T_bim_map @ final.backend.poses[keyframes], keyframes, final.clouds, standing)
    begins = odometry_begins(run.scans)
    signals = placed_signals(quality, run.in_map, begins, own, T_bim_map, standing, through)
    sound = shipped().judged(signals)
    place = PlaceReport(anchoring.posterior, sound, signals, T_bim_map)
    if not own.anchored.any():
        return place, why_none_is_anchored(own, config.quality)
    return place, contradiction(place.probability, sound, signals, config.anchors.withdraw)


def _contradictions(check: MapCheck) -> list[str]:
    """A warning for each control point that the map has more than three standard deviations off."""
    lines = []
    for own in (own for own in check.control if own.contradicts):
        off = f"{np.linalg.norm(own.residual_m):.3f} m off, {own.sigmas:.0f} standard deviations"
        lines.append(f"control point {own.name} is {off}: it contradicts the plan or the other points")
        _log.warning("%s", lines[-1])
    return lines


def _what_helps(matches: "MatchesFile | None", reason: str) -> list[str]:
    """A warning of what helps, where the matcher's answer is the `reason`; other reasons say it themselves."""
    if matches is None or matches["reason"] != reason or matches["status"] not in _HELPS:
        return []
    line = _HELPS[matches["status"]]
    _log.warning("%s", line)
    return [line]


def _quality(final: ActiveMap, run: RunPoses, own: ScanUncertainty, config: Config) -> Quality:
    """The signals of the map's quality; `own` is the uncertainty of the scans in the map."""
    count = len(run.all_scans)
    lost, unplaced = run.tracked["lost"] / count, (count - len(run.scans)) / count
    odometry, begins = odometry_of(run.scans), odometry_begins(run.scans)
    sights = Counter(sight.keyframe for floor in final.floors.maps for sight in floor.walls.seen)
    walls = [sights[k] for k in range(len(final.backend.keyframes))]
    return quality_of(run.in_map, odometry, begins, walls, own, lost, unplaced, config.quality)


def _live(scans: list[ScanPose], states: ScanUncertainty, T_bim_map: Floats | None) -> Trajectory:
    """The scans' poses in the map as they were estimated when each came; of an anchored run, in the BIM frame."""
    live = at_stamps(scans, np.stack([scan.T_map_sensor for scan in scans]))
    return live if T_bim_map is None else live.only(states.anchored).transformed(T_bim_map)
