"""The measurement of loop closure: its drives, what it calls false, its table and its command line."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from boxes import pose

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.drives.loop_buildings import DEPTH, PITCH, long_corridor, ring
from evaluation.drives.loop_drives import ROUTES, drive_along
from evaluation.studies.loops import COLUMNS, FALSE_M, FALSE_RAD, errors_of, measure, table
from sgslam.mapping import Closure


def test_an_office_looks_as_its_neighbour_does() -> None:
    from data.geometry.raycast import TriangleScene

    building = long_corridor(6)
    scene, angle = TriangleScene(building.triangles), np.linspace(-np.pi, np.pi, 90, endpoint=False)
    rays = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(90)])
    inside = building.inside[building.inside[:, 1] > 0]
    seen = [scene.distances(np.array([*place, 1.2]), rays) for place in inside[1:4]]
    near = [np.where(s < DEPTH / 2, s, 0.0) for s in seen]  # what is farther is seen through the door
    assert np.allclose(near[0], near[1], atol=1e-3) and np.allclose(near[1], near[2], atol=1e-3)
    assert np.allclose(np.diff(inside[:, 0]), PITCH)


@pytest.mark.parametrize("route", ROUTES)
def test_a_drive_runs_into_nothing_and_is_the_same_for_the_same_seed(route: str) -> None:
    drive = drive_along(route, 1)
    again = drive_along(route, 1)
    assert np.array_equal(drive.truth.poses, again.truth.poses)
    angle = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    rays = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(24)])
    ranges = [drive.scene.distances(T[:3, 3], rays).min() for T in drive.truth.poses[::25]]
    assert min(ranges) > 0.25


def test_the_ring_is_a_loop_and_along_is_none() -> None:
    way = ring().way
    assert np.allclose(way[0], way[-1]) and np.linalg.norm(np.diff(way, axis=0), axis=1).sum() > 120
    x = drive_along("along", 0).truth.positions[:, 0]
    assert (np.diff(x) >= -1e-9).all()


def test_an_unknown_route_is_refused() -> None:
    with pytest.raises(UserError, match="unknown route 'up'"):
        drive_along("up", 0)


def test_a_closure_is_judged_by_its_motion_whatever_the_frame() -> None:
    truth = Trajectory(np.array([10, 20, 30]), np.array([pose(0, 0, 0, 0), pose(5, 0, 0, 1.0), pose(5, 2, 0, 2.0)]))
    right = np.linalg.inv(truth.poses[0]) @ truth.poses[2]
    made = [Closure(0, 1, T, np.eye(6), 0.0, 0.0, "position", "") for T in (right, right @ pose(0.6, 0, 0, 0.2))]
    (off, turn), (far, turned) = errors_of(made, [10, 30], truth)
    assert off < 1e-9 and turn < 1e-7
    assert far == pytest.approx(0.6) and far > FALSE_M and turned == pytest.approx(0.2) and turned > FALSE_RAD


def record(loops: bool, seed: int, ape: float, false: int) -> dict[str, str]:
    values = dict.fromkeys(COLUMNS, "1")
    return values | {
        "drive": "ring", "front_end": "weak", "seed": str(seed), "loops": str(loops), "ape_m": str(ape),
        "false": str(false), "closure_m": "0.02" if loops else "",
    }  # fmt: skip


def test_the_table_sets_open_beside_closed() -> None:
    rows = [record(True, 0, 0.1, 0), record(True, 1, 0.3, 2), record(False, 0, 0.5, 0), record(False, 1, 0.7, 0)]
    cells = [cell.strip() for cell in table(rows).splitlines()[2].strip("|").split("|")]
    assert cells[:6] == ["ring", "weak", "2", "1", "0.600", "0.200"]
    assert cells[14] == "2", "false closures are counted, not averaged"


def test_what_is_measured_already_is_not_run_again(tmp_path: Path) -> None:
    rows = [record(True, 0, 0.1, 0), record(False, 0, 0.5, 0)]
    with (tmp_path / "loops.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    assert measure(["ring"], [], ["weak"], [0], tmp_path) == rows


@pytest.mark.slow
def test_the_command_line_refuses_an_unknown_route(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluation.studies.loops", "--out", str(tmp_path), "--routes", "up"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "up" in done.stderr and "Traceback" not in done.stderr
