"""What a run says of its own map: walls that are held out of it, and surveyed points."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from drives import fed, small_drive
from shared_runs import write_scans
from small_ifc import write_small_ifc

from data.common.errors import UserError
from data.control import ControlPoint, read_control
from data.scene_graph import Georeference
from sgslam.config import Config, OdometrySettings
from sgslam.report.tables import control_rows, run_rows
from sgslam.slam import SceneGraphSlam

SEEN = (0.3, 0.2, -0.5)  # m, in the sensor's frame


def points(**off: float) -> list[ControlPoint]:
    """Points that some scans see, with errors of 4 mm; some are `off` along x."""
    rng, found = np.random.default_rng(1), []
    for k in (10, 40, 70, 100, 130):
        stamp_ns, name = small_drive().scans[k][0], f"P{k}"
        T = small_drive().truth.at(np.array([stamp_ns]))[0]
        x, y, z = (T[:3, :3] @ SEEN + T[:3, 3] + rng.normal(0.0, 0.004, 3)).tolist()
        found.append(ControlPoint(name, (x + off.get(name, 0.0), y, z), stamp_ns, SEEN, 0.004))
    return found


def test_control_points_hold_the_map_but_one_that_contradicts_and_walls_held_out_agree() -> None:
    drive = small_drive()
    late = replace(points()[0], name="late", stamp_ns=drive.scans[-1][0] + 10**10)
    result = fed(SceneGraphSlam(drive.bim, control=[*points(P70=0.3), late]), drive.scans).finish()
    assert drive.rmse(result) < 0.01
    off = {own.name: np.abs(own.residual_m).max() for own in result.check.control}
    assert off.pop("P70") == pytest.approx(0.3, abs=0.02) and len(off) == 4 and max(off.values()) < 0.012
    one, other = (line for line in result.advice if "control point" in line)
    assert "1 of 6 control points are not used" in one and "control point P70 is 0.3" in other
    metrics = result.metrics()
    assert [row[-1] for row in control_rows(metrics)] == ["", "", "contradicts the rest", "", ""]
    held_out = metrics["held_out"]
    assert held_out["walls"] >= 8 and held_out["rms_m"] < 0.012 and held_out["within_95"] > 0.9
    assert any("off the plan" in text for text in run_rows(metrics).values())


def test_control_points_that_are_all_wrong_alike_do_not_move_the_map() -> None:
    """Their heights are those of the floor, and not of the sensor."""
    drive, low = small_drive(), [replace(own, place=(*own.place[:2], own.place[2] - 0.8)) for own in points()]
    result = fed(SceneGraphSlam(drive.bim, control=low), drive.scans).finish()
    assert drive.rmse(result) < 0.01
    assert len(result.check.control) == 5 and all(own.contradicts for own in result.check.control)


def test_walls_held_out_of_a_bent_map_are_off() -> None:
    """The poses are given as exact, and turn by two degrees in a metre too much."""
    drive = small_drive()
    sure = OdometrySettings(method="kiss", other_sigma_rotation=1e-5, other_sigma_translation=1e-5)
    slam, bent, before = SceneGraphSlam(drive.bim, config=Config(odometry=sure)), np.eye(4), None
    for stamp_ns, scan in drive.scans:
        T = drive.truth.at(np.array([stamp_ns]))[0]
        step = np.eye(4) if before is None else np.linalg.inv(before) @ T
        turn = 0.006 * float(np.linalg.norm(step[:3, 3]))
        step[:2, :2] = step[:2, :2] @ [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        bent, before = bent @ step, T
        slam.add_scan(stamp_ns, scan, np.zeros(len(scan)), bent)
    check = slam.finish().check.to_dict()["held_out"]
    assert check["rms_m"] > 0.03 and check["within_95"] < 0.8


def test_points_on_the_map_are_those_in_the_plan(tmp_path: Path) -> None:
    file, known = tmp_path / "points.csv", Georeference("EPSG:25832", 4e5, 5.5e6, 30.0, 0.6)
    file.write_text("name,x,y,z,stamp_s,sigma\n# surveyed\nA,1.5,2,0.25,1700000000.5,0.003\n")
    (in_plan,) = read_control(file, None)
    assert in_plan == ControlPoint("A", (1.5, 2.0, 0.25), 1_700_000_000_500_000_000, sigma=0.003)
    e, n, h = known.on_map(np.array([in_plan.place]))[0]
    file.write_text(f"name,easting,northing,height,stamp_ns,sensor_x,sensor_y,sensor_z\nA,{e},{n},{h},5,0,0,-1.5\n")
    (on_map,) = read_control(file, known)
    np.testing.assert_allclose(on_map.place, in_plan.place, atol=1e-8)
    assert (on_map.stamp_ns, on_map.in_sensor, on_map.sigma) == (5, (0.0, 0.0, -1.5), 0.01)
    with pytest.raises(UserError, match="IfcMapConversion"):
        read_control(file, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x,y,z\nA,1,2,3\n", "not control points .*stamp_s"),
        ("name,x,y,stamp_s\nA,1,2,3\n", "lacks columns"),
        ("name,x,y,z,stamp_s\n", "has no points"),
        ("name,x,y,z,stamp_s\nA,1,2,3\n", "zip"),
        ("name,x,y,z,stamp_s\nA,1,two,3,1.5\n", "could not convert string to float: 'two'"),
        ("name,x,y,z,stamp_s,sigma\nA,1,2,3,1.5,-1\n", "A has a number"),
        ("name,x,y,z,stamp_s\nA,1,2,3,1\nA,1,2,3,2\n", "names a point twice"),
    ],
)
def test_files_that_hold_no_points_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        read_control(tmp_path / "points.csv", None)


def test_points_of_another_day_are_refused_before_the_run(tmp_path: Path) -> None:
    ifc, scans, file = write_small_ifc(tmp_path / "a.ifc").path, write_scans(tmp_path / "scans", 3), tmp_path / "p.csv"
    file.write_text("name,x,y,z,stamp_s\nA,1,2,3,1700000000\n")
    assert "no scan is near the time of point A" in refused(
        "sgslam.run", "--scan-dir", scans, "--bim", ifc, "--control", file
    )
    assert "give --bim too" in refused("sgslam.run", "--scan-dir", scans, "--control", file)
