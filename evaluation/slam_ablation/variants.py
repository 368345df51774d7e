"""The variants of the ablation: a sequence is run with a part of the system left out or replaced by the truth."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.plans.mesh_files import is_mesh
from data.scans import Scan, ScanFolder
from data.trajectory import Trajectory
from evaluation.harness import Sequence
from evaluation.drives.sequences import odometry_alone, storey_of
from evaluation.drives.stand_in_matchers import OracleMatcher, WrongMatches
from evaluation.drives.weakened import shortened
from evaluation.slam_ablation.icp_to_bim import register_to_bim, surfaces_of_graph, surfaces_of_ifc
from evaluation.slam_ablation.rows import Row, errors_over_time, map_numbers, trajectory_numbers
from matching import Matcher
from sgslam.anchoring.floor_anchoring import AnyMatcher
from sgslam.config import AnchorSettings, Config, MatchingSettings
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

VARIANTS = {
    "odometry": "KISS-ICP alone with the system's settings, its first pose set to the truth",
    "icp-to-bim": "each scan registered to the BIM's surfaces, from the true initial pose",
    "graph": "the S-graph without anchors, its first pose set to the truth",
    "planes": "plane anchors only",
    "rooms": "room anchors only",
    "anchored": "plane and room anchors; anchored:METHOD with another matcher",
    "oracle": "plane and room anchors, from the true matches",
}
WITHOUT_BIM = ("odometry", "graph")


@dataclass(frozen=True, eq=False)
class Run:
    """A row, and (M, 2) seconds and position errors (m), None without a trajectory in the BIM frame."""

    row: Row
    errors: NDArray[np.float64] | None


def check_variant(variant: str) -> str:
    """Returns the variant. Raises UserError if it does not exist."""
    kind, _, method = variant.partition(":")
    if kind not in VARIANTS or (":" in variant and (kind != "anchored" or not method)):
        raise UserError(f"unknown variant '{variant}'; use {', '.join(VARIANTS)} or anchored:METHOD")
    if method:
        Matcher.load(method)
    return variant


def config_of(variant: str, sequence: Sequence) -> Config:
    """The settings of a variant's run."""
    method = variant.partition(":")[2] or Config().matching.method
    anchors = AnchorSettings(planes=variant != "rooms", rooms=variant != "planes")
    return Config(anchors=anchors, matching=MatchingSettings(method=method))


def run_variants(variants: tuple[str, ...], sequence: Sequence) -> list[Run]:
    """Runs one variant, or both that use no BIM."""
    if variants == ("icp-to-bim",):
        return [_registered(sequence)]
    if variants[0] == "odometry":
        return [_odometry_alone(sequence), *(run_variants(variants[1:], sequence) if variants[1:] else [])]
    config = config_of(variants[0], sequence)
    bim = None if variants[0] in WITHOUT_BIM else sequence.a_graph
    slam = SceneGraphSlam(bim, _matcher(variants[0], sequence, config), config)
    odometry = None if sequence.weak is None else sequence.weak.trajectory.poses
    began = perf_counter()
    for k, scan in enumerate(scans := _Scans(sequence)):
        slam.add_scan(scan.stamp_ns, scan.points, T_odom_sensor=None if odometry is None else odometry[k])
    result = slam.finish()
    seconds = perf_counter() - began
    return [_measured(variant, sequence, result, seconds, scans.seconds) for variant in variants]


class _Scans:
    """The sequence's scans under its conditions; `seconds` is the time that reading them took."""

    def __init__(self, sequence: Sequence) -> None:
        self._folder, self._weak, self.seconds = ScanFolder(sequence.scan_dir), sequence.weak is not None, 0.0

    def __iter__(self) -> Iterator[Scan]:
        scans = iter(self._folder)
        while True:
            began = perf_counter()
            scan = next(scans, None)
            self.seconds += perf_counter() - began
            if scan is None:
                return
            yield replace(scan, points=shortened(scan.points)) if self._weak else scan


def _matcher(variant: str, sequence: Sequence, config: Config) -> AnyMatcher | None:
    if variant in WITHOUT_BIM:
        return None
    T_bim_map = sequence.truth.poses[0]
    if variant == "oracle":
        return OracleMatcher(T_bim_map, storey_of(sequence.a_graph, T_bim_map))
    matcher: AnyMatcher = Matcher.load(config.matching.method)
    wrong = sequence.conditions.wrong_matches
    return WrongMatches(matcher, wrong, sequence.seed) if wrong else matcher


def _measured(variant: str, sequence: Sequence, result: Result, seconds: float, reading: float) -> Run:
    estimate = _estimate(variant, result, sequence.truth.poses[0])
    stages: dict[str, Any] = {f"seconds_{stage}": spent for stage, spent in result.seconds.items()}
    row = Row(
        **_heading(variant, sequence), anchored=result.anchored, total_poses=len(result.trajectory),
        scans=len(result.trajectory), seconds=seconds, seconds_reading=reading, **stages,
        first_anchor_s=result.first_anchor_s, reason=result.reason, peak_memory_mb=_peak_memory_mb(),
        **trajectory_numbers(estimate, sequence.truth), **map_numbers(result, sequence),
    )  # fmt: skip
    return Run(row, None if estimate is None else errors_over_time(estimate, sequence.truth))


def _registered(sequence: Sequence) -> Run:
    if is_mesh(sequence.bim):
        from data.plans.mesh_plan import read_mesh

        surfaces = read_mesh(sequence.bim).triangles
    elif sequence.bim.suffix.lower() == ".json":
        surfaces = surfaces_of_graph(sequence.a_graph)
    else:
        surfaces = surfaces_of_ifc(sequence.bim)
    began = perf_counter()
    scans = _Scans(sequence)
    estimate = register_to_bim(scans, surfaces, sequence.truth.poses[0])
    row = Row(
        **_heading("icp-to-bim", sequence), anchored=True, total_poses=len(estimate), scans=len(estimate),
        seconds=perf_counter() - began, seconds_reading=scans.seconds, peak_memory_mb=_peak_memory_mb(),
        reason="from the true initial pose", **trajectory_numbers(estimate, sequence.truth),
    )  # fmt: skip
    return Run(row, errors_over_time(estimate, sequence.truth))


def _odometry_alone(sequence: Sequence) -> Run:
    scans = _Scans(sequence)
    began = perf_counter()
    odometry = odometry_alone(scans) if sequence.weak is None else sequence.weak.trajectory
    seconds = perf_counter() - began
    estimate = _from_first(odometry, sequence.truth.poses[0])
    row = Row(
        **_heading("odometry", sequence), anchored=False, total_poses=len(estimate), scans=len(estimate),
        seconds=seconds, seconds_reading=scans.seconds, seconds_odometry=seconds - scans.seconds,
        reason="no BIM was given", peak_memory_mb=_peak_memory_mb(), **trajectory_numbers(estimate, sequence.truth),
    )  # fmt: skip
    return Run(row, errors_over_time(estimate, sequence.truth))


def _from_first(own: Trajectory, T_bim_first: NDArray[np.float64]) -> Trajectory:
    return own.transformed(T_bim_first @ np.linalg.inv(own.poses[0]))


def _heading(variant: str, sequence: Sequence) -> dict[str, Any]:
    weakening = "" if sequence.weak is None else sequence.weak.describe()
    if variant == "icp-to-bim" and weakening:
        weakening = weakening.split(";")[0] + "; it uses no odometry"
    return {
        "sequence": sequence.name, "conditions": sequence.conditions.name, "seed": sequence.seed, "arm": variant,
        "weakening": weakening,
    }  # fmt: skip


def _estimate(variant: str, result: Result, T_bim_first: NDArray[np.float64]) -> Trajectory | None:
    """The variant's trajectory in the BIM frame; None if a variant with anchors is not anchored."""
    if variant in WITHOUT_BIM:
        return _from_first(result.trajectory_map, T_bim_first)
    return result.trajectory if result.anchored else None


def _peak_memory_mb() -> float | None:
    """Peak memory (MB) of this process, from /proc; `getrusage` would include the parent of a fork."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return None
    found = re.search(r"^VmHWM:\s+(\d+) kB", status, re.MULTILINE)
    return int(found.group(1)) / 1024 if found else None
