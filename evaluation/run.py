"""Runs a case: the system, its tracker alone, or a peer, on the scans of a drive."""

import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from data.common.build import content_hash
from data.common.errors import UserError
from data.plans.bim import IFC_SUFFIXES
from data.scans import Scan
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.buildings import building_file, building_named, flat_plan_of, generated, plan_graph, storey_of
from evaluation.conditions import (
    LOW_M,
    NO_PLACE,
    Troubled,
    doubled,
    leaves_of,
    with_doors_as_walls,
    with_levels_off,
    with_levels_raised,
    without_half_of_its_walls,
)
from evaluation.drive import Drive, DriveCase, drive_of, release
from evaluation.elements import verdicts_of
from evaluation.metrics.maps import room_scores, wall_scores
from evaluation.metrics.matches import matching_scores
from evaluation.metrics.tracking import PoseClaims, errors_over_time, reliability
from evaluation.metrics.trajectories import origin_alignment, wrong_poses
from evaluation.metrics.true_matches import true_matches
from evaluation.outcome import NO_POSES, Outcome
from evaluation.peers.icp_to_bim import register_to_bim, surfaces_of
from evaluation.stand_ins import OracleMatcher, weakened, within_range
from evaluation.study import Options, Record, Study
from evaluation.tables import in_words
from evaluation.tracker import tracked, with_samples
from evaluation.variants import ICP_TO_BIM, ODOMETRIES, PEERS, TRACKERS, Variant, variant_named
from matching import Matcher, MatchResult
from matching.matcher import make_ready
from matching.result import AnyMatcher
from sgslam.config import AsBuiltSettings, Config
from sgslam.odometry.factory import ExternalOdometry
from sgslam.result import Result
from sgslam.slam import SceneGraphSlam
from sgslam.types import Update

Array = NDArray[np.float64]
FOREIGN = generated(99)[:2]  # the plans of other buildings; the second one for a drive through the first
TOLERANCE_M = 0.01  # up to which an element counts as planned, where the building differs from its plan


def run(case: DriveCase, work: Path) -> Record:
    """The record of a case: all measures of its run.

    Raises UserError as the simulator and the run do.
    """
    return described(case) | outcome_of(case, work).measures()


def described(case: DriveCase) -> Record:
    """What tables need of a case besides its fields: the role of the building, and the name of the drive."""
    name = blake2b(case.group.encode(), digest_size=6).hexdigest()
    return {"role": building_named(case.building).role, "drive": name, "status": "done"}


def outcome_of(case: DriveCase, work: Path) -> Outcome:
    """What the run of a case leaves, kept in `work` as long as our packages are the same."""
    build = content_hash(case.depends)
    path = work / "runs" / f"{blake2b((case.key + build).encode(), digest_size=12).hexdigest()}.npz"
    if not path.exists():
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # the peak memory is that of this run
        _made(case, drive_of(case, work), work).save(path)
    return Outcome.load(path)


def _made(case: DriveCase, drive: Drive, work: Path) -> Outcome:
    leaves = leaves_of(plan_graph(drive.plan)) if case.trouble == "sliding doors" else ()
    sent = Troubled(drive, case.trouble, case.times, leaves)
    if case.variant in TRACKERS:
        return _tracker(case, drive, sent)
    if case.variant in PEERS:
        return _peer(case, drive, sent)
    return _system(case, variant_named(case.variant), drive, sent, work)


def _system(case: DriveCase, variant: Variant, drive: Drive, sent: Troubled, work: Path) -> Outcome:
    config = Config.model_validate(dict(variant.settings))
    if case.changes:
        config = config.model_copy(update={"as_built": AsBuiltSettings(tolerance=TOLERANCE_M)})
    plan, truth = (_plan(case, drive, work) if variant.plan else None), sent.truth
    storey = _another_storey(plan, truth) if plan is not None and case.trouble == "wrong storey" else None
    matcher = None if plan is None else _matcher(variant, config, plan, truth)
    odometry = _odometry(case, variant, sent)

    def scans() -> Iterator[Scan]:
        return within_range(sent.scans()) if variant.weakened else sent.scans()

    samples = drive.samples if variant.imu else None
    slam = SceneGraphSlam(plan, matcher, config, storey=storey)
    began, live = process_time(), list[Update]()
    for scan in scans() if samples is None else with_samples(scans(), samples, slam.add_imu):
        T_odom_sensor = None if odometry is None else odometry.at(scan.stamp_ns)
        live.append(slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor))
    result = slam.finish(variant.second_pass)
    cpu_s = process_time() - began
    facts = _facts(result) | {"kidnaps": slam.kidnaps, "cpu_s": cpu_s, "scans_per_s": len(live) / cpu_s}
    facts |= {"length_m": drive.length_m, "peak_mb": _peak_mb()}
    if plan is not None and case.trouble not in NO_PLACE:
        facts |= _map_facts(result, plan, truth) | {"placed": _placed(result, truth)}
    if case.changes and result.anchored and drive.plan.suffix.lower() in IFC_SUFFIXES:
        facts |= verdicts_of(case, drive, result, building_file(case.building, work)[0])
    aligned = result.trajectory_map
    if not variant.plan:  # without a plan the first pose is given
        aligned = aligned.transformed(origin_alignment(aligned, truth))
    known = result.uncertainty
    return Outcome(
        scans=len(live),
        truth=truth,
        anchored=result.trajectory if result.anchored else NO_POSES if variant.plan else aligned,
        map=result.trajectory_map,
        odometry=result.trajectory_odometry,
        live=_live(live),
        stamps_ns=known.stamps_ns,
        sigma=known.sigma if variant.plan else np.full_like(known.sigma, np.nan),  # of another frame
        health=tuple(known.health.tolist()),
        no_place=case.trouble in NO_PLACE,
        facts=facts,
    )


def _plan(case: DriveCase, drive: Drive, work: Path) -> SceneGraph:
    """The plan that is given: the whole building's, unless the trouble is of the plan."""
    if case.trouble == "foreign plan":
        name = next(name for name in FOREIGN if name != case.building)
        return plan_graph(building_file(name, work)[0])
    plan = plan_graph(drive.plan)
    if case.trouble == "half the walls":
        return without_half_of_its_walls(plan, case.seed)
    if case.trouble == "sliding doors":
        return with_doors_as_walls(plan)
    if case.trouble == "flat plan":
        return plan_graph(flat_plan_of(case.building, work))
    if case.trouble == "low ceilings":
        return with_levels_raised(plan, 0.0, -LOW_M)
    if case.trouble == "levels off":
        return with_levels_off(plan, zlib.crc32(case.key.encode()))
    return doubled(plan) if case.trouble == "doubled plan" else plan


def _another_storey(plan: SceneGraph, truth: Trajectory) -> str:
    true = storey_of(plan, truth.poses[0])
    other = next((floor.id for floor in plan.floors if floor.id != true), None)
    if other is None:
        raise UserError("a wrong storey cannot be stated of a building with one; leave it out")
    return other


def _matcher(variant: Variant, config: Config, plan: SceneGraph, truth: Trajectory) -> AnyMatcher:
    if variant.matcher == "oracle":
        first = truth.poses[0]
        return OracleMatcher(first, storey_of(plan, first))
    matcher = Matcher.load(variant.matcher or config.matching.method)
    make_ready(matcher)  # compiling is not part of the run's time
    return matcher


def _odometry(case: DriveCase, variant: Variant, sent: Troubled) -> ExternalOdometry | None:
    if not variant.weakened:
        return None
    return ExternalOdometry(weakened(tracked(sent.scans()).poses, sent.truth, case.seed))


def _live(updates: list[Update]) -> Trajectory:
    """The poses in the BIM frame that were known when the scans came."""
    placed = {u.stamp_ns: u.T_bim_sensor for u in updates if u.T_bim_sensor is not None and u.health != "lost"}
    return Trajectory(np.array([*placed], np.int64), np.reshape([*placed.values()], (-1, 4, 4)))


def _facts(result: Result) -> Record:
    return {
        "reason": result.reason,
        "place": None if result.place is None else [result.place.probability, result.place.posterior.two_best[1][0]],
        "first_anchor_s": result.first_anchor_s,
        "alarms": [name for name, signal in result.quality.items() if not signal.ok],
        "match_status": "none" if result.matches is None else result.matches["status"],
        "floors": len(result.s_graph.floors),
        "rooms": len(result.s_graph.rooms),
        "keyframes": result.keyframes,
    }


def _placed(result: Result, truth: Trajectory) -> Record | None:
    """Of a map that had a place, though it may have been withdrawn: its signals of soundness, and how many of its
    scans, without lost ones, are wrong there; None for a map without a place."""
    place, known = result.place, result.uncertainty
    if place is None or place.T_bim_map is None:
        return None
    kept = known.known
    poses = result.trajectory_map.only(kept).transformed(place.T_bim_map)
    return {"scans": len(poses), "wrong": wrong_poses(poses, truth), "signals": dict(place.signals)}


def _map_facts(result: Result, plan: SceneGraph, truth: Trajectory) -> Record:
    """Walls, rooms and matches of the map against the storey of the first pose; walls and rooms to be found are those
    of rooms that were entered. Empty for a map of several storeys, and where no room was entered."""
    T_bim_map = origin_alignment(result.trajectory_map, truth)
    floor = plan.on_floor(storey_of(plan, T_bim_map) or (plan.floors[0].id if plan.floors else None))
    places = shapely.points(truth.positions[::5, :2])
    areas = {r.id: shapely.Polygon(r.polygon) for r in floor.rooms if r.polygon is not None and len(r.polygon) > 2}
    entered = {key for key, area in areas.items() if shapely.contains(area, places).any()}
    if len(result.s_graph.floors) > 1 or not entered:
        return {}
    found: dict[str, Any] = {}
    with suppress(UserError):  # a map that is upside down
        walls = wall_scores(result.s_graph, floor, T_bim_map, {w.id for w in floor.wall_surfaces if w.room in entered})
        rooms = room_scores(result.s_graph, floor, T_bim_map, entered)
        offset = None if walls.offset_mm is None else walls.offset_mm.median
        found |= {"wall_precision": walls.score.precision, "wall_recall": walls.score.recall, "wall_offset_mm": offset}
        found |= {"room_precision": rooms.precision, "room_recall": rooms.recall}
    if found and result.matches is not None and result.anchored:
        rooms_found, walls_found = (
            tuple(
                {str(s): (str(s), str(a), float(c)) for s, a, c in reversed(kind)}.values()
            )  # the first of several answers
            for kind in (result.matches["rooms"], result.matches["wall_surfaces"])
        )
        answer = MatchResult("unique", "", rooms_found, walls_found)
        score = matching_scores(answer, true_matches(result.s_graph, floor, T_bim_map), result.s_graph).wall_surfaces
        found |= {"match_precision": score.precision, "match_recall": score.recall}
    return found


def _tracker(case: DriveCase, drive: Drive, sent: Troubled) -> Outcome:
    samples = drive.samples if case.variant == "tracking with IMU" else None
    began = process_time()
    found = tracked(sent.scans(), samples)
    cpu_s = process_time() - began
    poses, truth = found.poses, sent.truth
    health = np.array([scan.health for scan in found.scans])
    claims = PoseClaims(np.stack([s.covariance for s in found.scans]), health, poses.poses[:, 2, :3])
    facts: Record = {
        "kidnaps": found.kidnaps,
        "cpu_s": cpu_s,
        "scans_per_s": len(poses) / cpu_s,
        "length_m": drive.length_m,
    }
    facts["reliability"] = reliability(claims, poses, truth).model_dump()
    count = sum(1 for _ in sent.scans())
    return Outcome(count, truth, odometry=poses, stamps_ns=poses.stamps_ns, health=tuple(health), facts=facts)


def _peer(case: DriveCase, drive: Drive, sent: Troubled) -> Outcome:
    truth, began = sent.truth, process_time()
    if case.variant == ICP_TO_BIM:
        found = register_to_bim(sent.scans(), surfaces_of(drive.plan), truth.poses[0])
        in_bim = poses = _at_best_instant(found, drive, truth, times=False)  # it does not deskew
    else:
        samples = None if case.imu is None else drive.samples
        poses = _at_best_instant(ODOMETRIES[case.variant](sent.scans(), samples), drive, truth, case.times)
        first = Trajectory(poses.stamps_ns, truth.at(poses.stamps_ns))
        in_bim = poses.transformed(origin_alignment(poses, first))  # the first pose is given
    cpu_s = process_time() - began
    count = sum(1 for _ in sent.scans())
    facts = {"cpu_s": cpu_s, "scans_per_s": count / cpu_s, "length_m": drive.length_m}
    exact = Trajectory(poses.stamps_ns, truth.at(poses.stamps_ns))
    return Outcome(count, exact, anchored=in_bim, map=poses, odometry=poses, facts=facts)


def _at_best_instant(poses: Trajectory, drive: Drive, truth: Trajectory, times: bool) -> Trajectory:
    """The poses at the instants of the scans at which they hold: at their ends, to which the peers deskew; where the
    points have no times it is unknown, and the best of beginning, middle and end counts."""

    def shifted(instant: float) -> Trajectory:
        return Trajectory(poses.stamps_ns + round(1e9 * instant * drive.period_s), poses.poses)

    if times:
        return shifted(1.0)
    error = {at: float(np.median(errors_over_time(shifted(at), truth).translation_m)) for at in (0.0, 0.5, 1.0)}
    return shifted(min(error, key=lambda at: error[at]))


def _peak_mb() -> float | None:
    """The peak memory (MB) of this process."""
    with suppress(OSError):
        found = re.search(r"^VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
        return int(found.group(1)) / 1024 if found else None
    return None


def study_of_runs(
    name: str,
    asks: str,
    quick: Options,
    cases: Callable[[Any], Sequence[DriveCase]],
    tables: Callable[[pd.DataFrame], Any],
    claims: Callable[[pd.DataFrame], Any],
    **more: Any,
) -> Study:
    """A study whose cases are runs on drives."""
    return Study(
        name=name,
        asks=asks,
        options=type(quick),
        quick=quick,
        cases=cases,
        tables=lambda rows: tables(in_words(rows)),
        claims=lambda rows: claims(in_words(rows)),
        **{"case": DriveCase, "measure": run, "release": release, **more},
    )
