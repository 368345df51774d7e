"""The measurement of loop closure: its drives, what it calls false, and its table."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from boxes import pose
from study_rows import rows_of

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.drives.loop_buildings import DEPTH, PITCH, long_corridor, ring
from evaluation.drives.loop_drives import Route, drive_along
from evaluation.drives.sequences import SequenceSpec
from evaluation.studies.loops import FALSE_M, FALSE_RAD, Choice, Errors, Run, cases, errors_of, tables
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


@pytest.mark.parametrize("route", get_args(Route))
def test_a_drive_runs_into_nothing_and_is_the_same_for_the_same_seed(route: Route) -> None:
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


def test_a_closure_is_judged_by_its_motion_whatever_the_frame() -> None:
    truth = Trajectory(np.array([10, 20, 30]), np.array([pose(0, 0, 0, 0), pose(5, 0, 0, 1.0), pose(5, 2, 0, 2.0)]))
    right = np.linalg.inv(truth.poses[0]) @ truth.poses[2]
    made = [Closure(0, 1, T, np.eye(6), 0.0, 0.0, "position", "") for T in (right, right @ pose(0.6, 0, 0, 0.2))]
    (off, turn), (far, turned) = errors_of(made, [10, 30], truth)
    assert off < 1e-9 and turn < 1e-7
    assert far == pytest.approx(0.6) and far > FALSE_M and turned == pytest.approx(0.2) and turned > FALSE_RAD


def run(closing: bool, seed: int, ape: float, false: int) -> tuple[Run, Errors]:
    values: dict[str, float | None] = dict.fromkeys(Errors.model_fields, 1)
    values |= {"ape_m": ape, "false": false, "closures": 3, "closure_m": 0.02 if closing else None}
    case = Run(drive="ring", storey=None, front_end="trusted", seed=seed, closing=closing)
    return case, Errors.model_validate(values)


def test_the_table_sets_open_beside_closed() -> None:
    rows = rows_of([run(True, 0, 0.1, 0), run(True, 1, 0.3, 2), run(False, 0, 0.5, 0), run(False, 1, 0.7, 0)])
    (cells,) = tables(rows)["drives"].to_numpy().tolist()
    assert cells[:6] == ["ring", "trusted", "2", "1", "0.600", "0.200"]
    assert cells[14:16] == ["2", "0.020"], "false closures are counted, not averaged"


def test_drives_that_never_come_back_are_run_with_loop_closure_alone() -> None:
    chosen = cases(Choice(routes=("along", "ring"), sequences=("institute",), front_ends=("trusted",), seeds=(4,)))
    assert [(case.drive, case.closing) for case in chosen] == [
        ("along", True), ("ring", True), ("ring", False), ("institute", True), ("institute", False)
    ]  # fmt: skip
    assert not chosen[1].files() and len(chosen[-1].files()) == 1


def test_a_recorded_sequence_is_refused(tmp_path: Path) -> None:
    spec = SequenceSpec(name="own", bim="own.ifc", scans="scans", truth="truth.tum")
    (tmp_path / "list.yaml").write_text(f"[{spec.model_dump_json()}]")
    with pytest.raises(UserError, match="'own': needs an IFC model"):
        cases(Choice(listed=tmp_path / "list.yaml", sequences=("own",)))
