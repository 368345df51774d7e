"""`python -m evaluation.maps`: writes maps by SLAM at moments of drives, with their true places, to train the judge.

The maps are not anchored, so that they grow until the end.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.cli import Parser, run_command
from data.geometry import se2
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from evaluation.buildings import plan_graph, storey_of
from evaluation.conditions import Troubled
from evaluation.drive import Drive, DriveCase, drive_of, release
from evaluation.known_maps import BUILDINGS, DRIVES, MOST_BENT_M
from evaluation.matching.own_maps import Recorder
from matching.training.slam_maps import MapInPlan
from sgslam.slam import SceneGraphSlam

MOMENTS = 20  # of a drive, at most
TROUBLES = (
    "", "sliding doors", "dropout 3", "people 3", "occlusion 2", "sparsity 3", "vibration 2", "sliding doors", 
    "noise 2", "shaken", "gaps 2", "", "field of view 2",
)  # fmt: skip
Array = NDArray[np.float64]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(prog="python -m evaluation.maps", description="Write maps by SLAM, with their places in the plan.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the maps")
    parser.add_argument("--work", type=Path, default=Path("work"), metavar="DIR", help="of drives")
    parser.add_argument("--buildings", nargs="+", default=BUILDINGS, metavar="NAME", help="default: training buildings")
    parser.add_argument("--seconds", type=float, default=50.0, help="of each drive (default: %(default)s)")
    parser.add_argument("--drives", type=int, default=2, help="in each building (default: %(default)s)")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    troubles, drives = cycle(TROUBLES), cycle(enumerate(DRIVES))
    for building in options.buildings:
        for _ in range(options.drives):
            seed, (carrier, sensor) = next(drives)
            case = DriveCase(
                building=building, seed=seed, carrier=carrier, sensor=sensor, seconds=options.seconds,
                trouble=next(troubles),
            )  # fmt: skip
            drive = drive_of(case, options.work)
            count = sum(1 for _ in written(case, drive, options.out))
            release(case, options.work)
            print(f"{building}, {carrier} {sensor} {case.trouble}: {count} maps", flush=True)
    return 0


def written(case: DriveCase, drive: Drive, out: Path) -> Iterator[Path]:
    """Runs a drive and writes its maps, beside them its plan; yields the files."""
    plan, recorder = plan_graph(drive.plan), Recorder()
    sent = Troubled(drive, case.trouble)
    slam = SceneGraphSlam(plan, recorder)
    for scan in sent.scans():
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
    slam.finish(second_pass=False)
    name = case.building.replace("/", "_")
    plan.save(out / f"{name}.a_graph.json")
    moments = np.unique(np.linspace(0, len(recorder.every) - 1, min(MOMENTS, len(recorder.every))).astype(int))
    for k in moments.tolist():
        s = recorder.every[k]
        T_a_s, rmse_m, pose = place_of(s, sent.truth)
        if s.wall_surfaces and rmse_m <= MOST_BENT_M:
            path = out / f"{name}_{case.seed}_{case.carrier}_{k}.map.json"
            place = float(T_a_s[0]), float(T_a_s[1]), float(T_a_s[2])
            plain = replace(s, keyframes=())
            MapInPlan(case.building, plain, f"{name}.a_graph.json", place, storey_of(plan, pose)).save(path)
            yield path


def place_of(s: SceneGraph, truth: Trajectory) -> tuple[Array, float, Array]:
    """(3,) the true T_a_s (yaw, x, y) of a map by its keyframes, the RMSE (m) of these in it, and a true pose (4, 4).

    The yaw is that of the poses, since a map may be of one place, the shift the median.
    """
    poses = xyzquat_to_poses([k.pose for k in s.keyframes])
    true = truth.at(np.array([k.stamp_ns for k in s.keyframes]))
    turned = true[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)
    yaw = float(np.arctan2(turned[:, 1, 0].sum(), turned[:, 0, 0].sum()))
    off = true[:, :2, 3] - se2.rotate(yaw, poses[:, :2, 3])
    shift = np.median(off, axis=0)
    rmse_m = float(np.sqrt(((off - shift) ** 2).sum(axis=1).mean()))
    return np.array([yaw, *shift]), rmse_m, true[len(true) // 2]


if __name__ == "__main__":
    run_command(main)
