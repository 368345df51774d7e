"""The variants of the ablation: a sequence is run with a part of the system left out or replaced by the truth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan, ScanFolder
from data.trajectory import Trajectory
from evaluation.drives import Sequence
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import storey_of
from evaluation.drives.stand_in_matchers import OracleMatcher, WrongMatches
from evaluation.drives.weakened import within_range
from evaluation.metrics.trajectories import origin_alignment
from evaluation.slam_ablation.icp_to_bim import ALIGNERS, register_to_bim, surfaces_of
from evaluation.slam_ablation.peers import kiss_icp_alone, small_gicp_alone
from evaluation.slam_ablation.scores import Scores, scores_of
from matching import Matcher
from matching.self_test import make_ready
from sgslam.anchoring.floor_anchoring import AnyMatcher
from sgslam.config import AnchorSettings, Config, MatchingSettings
from sgslam.odometry.external import ExternalOdometry
from sgslam.slam import SceneGraphSlam

Array = NDArray[np.float64]

PEERS: dict[str, Callable[[Iterable[Scan]], Trajectory]] = {"kiss-icp": kiss_icp_alone, "small_gicp": small_gicp_alone}
WITHOUT_PLAN = (*PEERS, "graph")
WITHOUT_ANCHORS = (*WITHOUT_PLAN, *ALIGNERS)
SINGLE = "single-pass"
VARIANTS = (*PEERS, *ALIGNERS, "graph", "planes", "rooms", "anchored:voting", SINGLE, "anchored", "oracle")
"""`graph` is our map without the plan, `planes` and `rooms` have anchors of one kind only, `anchored:METHOD` has
another matcher than the default one, `single-pass` has no second pass, `oracle` has the true matches. Those without a
plan get the true first pose, and those of each scan to the BIM start from it; the one of several scales needs the extra
`open3d`."""


def check_variant(variant: str) -> str:
    """Returns the variant. Raises UserError if it does not exist."""
    kind, colon, method = variant.partition(":")
    if variant not in VARIANTS and (kind != "anchored" or not method):
        raise UserError(f"unknown variant '{variant}'; use {', '.join(VARIANTS)} or anchored:METHOD")
    if colon:
        Matcher.load(method)
    return variant


def run_variant(variant: str, sequence: Sequence) -> Scores:
    """Runs a variant on a sequence and measures it. Raises UserError as the run does."""
    run = _registration if variant in (*PEERS, *ALIGNERS) else _mapping
    return run(variant, sequence, _Scans(sequence))


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
            yield shortened_scan(scan) if self._weak else scan


def shortened_scan(scan: Scan) -> Scan:
    """The scan with the points that a weakened front end gets, and their times."""
    near = within_range(scan.points)
    times = None if scan.point_times is None else scan.point_times[near]
    return replace(scan, points=scan.points[near], point_times=times)


def _registration(variant: str, sequence: Sequence, scans: _Scans) -> Scores:
    first = sequence.truth.poses[0]
    surfaces = surfaces_of(sequence) if variant in ALIGNERS else None
    began = perf_counter()
    if surfaces is None:
        estimate = _from_first(PEERS[variant](scans), sequence.truth)
    else:
        estimate = register_to_bim(scans, surfaces, first, ALIGNERS[variant])
    return scores_of(sequence, estimate, None, perf_counter() - began, scans.seconds)


def _mapping(variant: str, sequence: Sequence, scans: _Scans) -> Scores:
    method = variant.partition(":")[2] or Config().matching.method
    anchors = AnchorSettings(planes=variant != "rooms", rooms=variant != "planes")
    config = Config(anchors=anchors, matching=MatchingSettings(method=method))
    plan, matcher = (None, None) if variant == "graph" else (sequence.a_graph, _matcher(variant, sequence, method))
    slam = SceneGraphSlam(plan, matcher, config)
    odometry = None if sequence.weak is None else ExternalOdometry(sequence.weak.trajectory)
    began = perf_counter()
    result = run_through(slam, scans, odometry, again=None if variant == SINGLE else scans)
    seconds = perf_counter() - began
    estimate = result.trajectory if result.anchored else None
    if variant == "graph":
        estimate = _from_first(result.trajectory_map, sequence.truth)
    return scores_of(sequence, estimate, result, seconds, scans.seconds)


def _matcher(variant: str, sequence: Sequence, method: str) -> AnyMatcher:
    first, wrong = sequence.truth.poses[0], sequence.conditions.wrong_matches
    if variant == "oracle":
        return OracleMatcher(first, storey_of(sequence.a_graph, first))
    matcher = Matcher.load(method)
    make_ready(matcher, method)  # compiling is not part of the run's time
    return WrongMatches(matcher, wrong, sequence.seed) if wrong else matcher


def _from_first(own: Trajectory, truth: Trajectory) -> Trajectory:
    return own.transformed(origin_alignment(own, truth))
