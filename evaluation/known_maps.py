"""`python -m evaluation.known_maps`: fits how probable a place in the map of an earlier run is.

Maps of training buildings are made by drives with all kinds of carriers and troubles, and each is looked for in the
others: in those of its building, which may not overlap, and in some of others.
"""

import json
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.cli import Parser, run_command
from data.common.files import write_json
from data.geometry import se2
from evaluation.conditions import Troubled
from evaluation.drive import DriveCase, drive_of, release
from evaluation.metrics.trajectories import origin_alignment
from matching import Matcher
from matching.training.calibrate import logistic
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.place_posterior import differ, lead
from sgslam.anchoring.soundness import FILE
from sgslam.slam import SceneGraphSlam

KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower")
BUILDINGS = (*(f"generated/{kind}_{seed}" for seed in (901_000, 901_001, 901_002) for kind in KINDS), "demo", "office")
DRIVES = (("wheeled", "VLP-16"), ("handheld", "VLP-16"), ("handheld", "Mid-360"), ("wheeled", "Mid-360"))
TROUBLES = ("", "dropout 3", "people 3", "occlusion 2", "sparsity 3", "", "vibration 2", "noise 2", "shaken", "gaps 2")
MOST_BENT_M = 0.3  # RMSE of a map that is looked for, or in: others are not sound
FOREIGN = 2  # maps of other buildings in which each is looked for
Array = NDArray[np.float64]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(prog="python -m evaluation.known_maps", description="Fit the probability of places in known maps.")
    parser.add_argument("--work", type=Path, default=Path("work"), metavar="DIR", help="of drives")
    parser.add_argument("--out", type=Path, default=FILE, metavar="FILE", help="default: the shipped file")
    options = parser.parse_args(arguments)
    maps = {building: list(maps_of(building, options.work)) for building in BUILDINGS}
    features, right = (np.array(column) for column in zip(*answers(maps), strict=True))
    model = [round(float(weight), 3) for weight in logistic(features, right)]
    write_json(options.out, {**json.loads(options.out.read_text()), "known_map": model})
    print(f"{len(right)} answers, {int(right.sum())} right: {model}")
    return 0


def maps_of(building: str, work: Path) -> Iterator[tuple[SceneGraph, Array]]:
    """Maps of a building with their true T_bim_map (3,), yaw x y, by drives without a plan."""
    troubles = cycle(TROUBLES)
    for seed, (carrier, sensor) in enumerate(DRIVES):
        case = DriveCase(
            building=building, seed=seed, carrier=carrier, sensor=sensor, seconds=40.0 + 20.0 * (seed % 2),
            trouble=next(troubles), variant="unanchored",
        )  # fmt: skip
        drive = drive_of(case, work)
        sent, slam = Troubled(drive, case.trouble), SceneGraphSlam()
        for scan in sent.scans():
            slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
        result = slam.finish()
        release(case, work)
        T = origin_alignment(result.trajectory_map, sent.truth)
        off = result.trajectory_map.transformed(T).positions - sent.truth.at(result.trajectory_map.stamps_ns)[:, :3, 3]
        if len(result.s_graph.floors) == 1 and np.sqrt((off**2).sum(axis=1).mean()) < MOST_BENT_M:
            yield result.s_graph, np.array([np.arctan2(T[1, 0], T[0, 0]), T[0, 3], T[1, 3]])


def answers(maps: dict[str, list[tuple[SceneGraph, Array]]]) -> Iterator[tuple[list[float], bool]]:
    """The features of the model for each map in each other one, and whether the best place is right."""
    rng, matcher = np.random.default_rng(0), Matcher.load("voting")
    for building, own in maps.items():
        others = [one for name, of in maps.items() if name != building for one in of]
        for k, (s, T_bim_s) in enumerate(own):
            known: list[tuple[SceneGraph, Array | None]] = []
            known += [(a, se2.compose(se2.inverse(T), T_bim_s)) for n, (a, T) in enumerate(own) if n != k]
            known += [(others[n][0], None) for n in rng.choice(len(others), FOREIGN, replace=False)]
            for a, T_a_s in known:
                found = matcher.match(s, a).hypotheses
                if found:
                    best = np.array(found[0].T_a_s)
                    leading = lead([h.probability or 0.0 for h in found])
                    conflict = conflict_share(s, a, best)
                    yield [leading, float(np.sqrt(conflict))], T_a_s is not None and not differ(best, T_a_s, s)


if __name__ == "__main__":
    run_command(main)
