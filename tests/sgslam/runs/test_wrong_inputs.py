"""Wrong input, as a user gives it: each is recognised, and told in one line that says what to do."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of
from commands import called, refused
from test_run import process

from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from data.simulation import SpinningSensor
from data.trajectory import Trajectory

SENSOR = SpinningSensor(azimuths=240, beams=32, lowest_deg=-45, highest_deg=45)
FOOT = 0.3048  # m


def write_walk(folder: Path, height: float = 2.7, carried: float = 1.4, pitch: float = 0.0, scans: int = 25) -> Path:
    """Scans of a room of that height (m), from a sensor that is carried through it at 1 m/s, 0.1 s apart."""
    scene = scene_of(room(-5, -4, 5, 4, height))
    folder.mkdir()
    for k in range(scans):
        np.save(folder / f"{k}.npy", scan(scene, pose(0.1 * k - 1, 0.5, carried, 0.2, pitch), SENSOR, seed=k))
    return folder


def write_changed(walk: Path, folder: Path, scale: float = 1.0, shift: float = 0.0, count: int = 25) -> Path:
    """The scans of a walk, the first `count` of them scaled and shifted (m)."""
    folder.mkdir()
    for k in range(len(list(walk.iterdir()))):
        points: Array = np.load(walk / f"{k}.npy")
        np.save(folder / f"{k}.npy", points if k >= count else scale * points + [shift, -shift, 0.0])
    return folder


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_walk(tmp_path_factory.mktemp("walk") / "scans")


def write_plan(path: Path, height: float) -> Path:
    """The room's own plan, with walls of that height (m)."""
    sides = [((-5, 0), (1, 0), 8), ((5, 0), (-1, 0), 8), ((0, -4), (0, 1), 10), ((0, 4), (0, -1), 10)]
    walls = tuple(
        WallSurface(f"w{k}", "room", middle, normal, float(length), "ground", height=(0.0, height))
        for k, (middle, normal, length) in enumerate(sides)
    )
    graph = SceneGraph("bim", (Room("room", (0.0, 0.0), "ground"),), walls, floors=(Floor("ground", "", 0.0),))
    graph.save(path)
    return path


def advice_of(out: Path) -> list[str]:
    """The lines of `advice` of a run."""
    lines: list[str] = json.loads((out / "metrics.json").read_text())["advice"]
    return lines


def told(done: subprocess.CompletedProcess[str], out: Path) -> list[str]:
    """The lines of `advice` that are in the terminal and in the report too."""
    report = (out / "report.html").read_text()
    return [line for line in advice_of(out) if line in done.stderr and line.replace("'", "&#39;") in report]


def errors(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What a run that was refused says, without the notes on stamps and, in the first run, on compiling."""
    lines = done.stderr.splitlines()
    return [line for line in lines if "0.1 s apart" not in line and not line.startswith("compiling")]


@pytest.mark.parametrize(
    ("scale", "shift", "said"), [(1000.0, 0.0, "divide millimetres by 1000"), (1.0, 300.0, "in one world frame")]
)
def test_another_unit_or_frame_is_refused_with_no_line_but_that(
    scale: float, shift: float, said: str, walk: Path, tmp_path: Path
) -> None:
    scans = write_changed(walk, tmp_path / "scans", scale, shift)
    done = process("--scan-dir", scans, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert [said in line for line in errors(done)] == [True]
    assert not (tmp_path / "out").exists()  # nor would earlier results be touched


@pytest.mark.slow
def test_every_warning_is_in_the_metrics_and_in_the_report(walk: Path, tmp_path: Path) -> None:
    scans = write_changed(walk, tmp_path / "scans")
    (scans / "7.npy").write_bytes(b"no scan")
    done = process("--scan-dir", scans, "--out", tmp_path / "out")
    assert done.returncode == 0
    assert [line for line in errors(done) if line not in told(done, tmp_path / "out")] == []
    assert any("7.npy: skipped" in line for line in told(done, tmp_path / "out"))
    assert any("0.1 s apart" in line for line in told(done, tmp_path / "out"))


@pytest.mark.slow
def test_two_odd_scans_at_the_beginning_prove_nothing(walk: Path, tmp_path: Path) -> None:
    scans = write_changed(walk, tmp_path / "scans", shift=300.0, count=2)
    assert called("sgslam.run", "--single-pass", "--scan-dir", scans, "--out", tmp_path / "out").returncode == 0


@pytest.mark.parametrize(
    ("step", "unit"), [("100", "milliseconds"), ("100000", "microseconds"), ("100000000", "nanoseconds")]
)
def test_stamps_in_another_unit_are_refused_and_it_is_named(step: str, unit: str, walk: Path, tmp_path: Path) -> None:
    scans = write_changed(walk, tmp_path / "scans")
    (scans / "times.txt").write_text("".join(f"{k * int(step)}\n" for k in range(25)))
    done = process("--scan-dir", scans, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert [f"seem to be in {unit}; give seconds" in line for line in errors(done)] == [True]


def test_degrees_for_the_start_are_refused_and_given_in_radians(walk: Path) -> None:
    done = process("--scan-dir", walk, "--start", "1,2,90")
    assert done.returncode == 2 and errors(done) == [
        "error: --start 1,2,90: the yaw is in radians; 90 degrees are 1.5708"
    ]
    assert "radians" in refused("sgslam.run", "--scan-dir", walk, "--start", "1,2,-6.3")
    assert "give --bim too" in refused("sgslam.run", "--scan-dir", walk, "--start", "1,2,-6.28")


def test_a_folder_above_the_scans_is_refused_and_theirs_are_named(walk: Path, tmp_path: Path) -> None:
    write_changed(walk, tmp_path / "second")
    done = process("--scan-dir", tmp_path)
    assert done.returncode == 2
    assert errors(done) == [
        f"error: {tmp_path}: no scans in it; there are some in {tmp_path / 'second'}; give that folder"
    ]
    (tmp_path / "10th").mkdir()
    write_changed(walk, tmp_path / "10th" / "points")
    both = f"{tmp_path / '10th' / 'points'}, {tmp_path / 'second'}; give one of these"
    assert both in refused("sgslam.run", "--scan-dir", tmp_path)


@pytest.mark.long
@pytest.mark.slow
def test_results_that_are_overwritten_are_named(walk: Path, tmp_path: Path) -> None:
    first = called("sgslam.run", "--single-pass", "--scan-dir", walk, "--out", tmp_path / "out")
    second = process("--scan-dir", walk, "--out", tmp_path / "out")
    assert first.returncode == second.returncode == 0
    assert "overwritten" not in first.stderr
    assert [str(tmp_path / "out") in line for line in second.stderr.splitlines() if "overwritten" in line] == [True]


@pytest.mark.long
@pytest.mark.slow
def test_a_mount_that_the_surroundings_contradict_is_told(tmp_path: Path) -> None:
    scans = write_walk(tmp_path / "scans", pitch=np.radians(50))
    done = process("--scan-dir", scans, "--mount", "0,0,0", "--out", tmp_path / "out")
    assert done.returncode == 0
    words = ("50 degrees from the stated mount", "its pitch 50 degrees")
    assert [all(word in line for word in words) for line in told(done, tmp_path / "out")].count(True) == 1
    done = called("sgslam.run", "--single-pass", "--scan-dir", scans, "--mount", "0,50,0", "--out", tmp_path / "right")
    assert done.returncode == 0 and not any("mount" in line for line in advice_of(tmp_path / "right"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planned", "said"),
    [(True, "the plan's walls are 2.7 m high"), pytest.param(False, "m/s: unless this", marks=pytest.mark.long)],
)
def test_feet_are_told(planned: bool, said: str, walk: Path, tmp_path: Path) -> None:
    scans = write_changed(walk, tmp_path / "scans", 1 / FOOT)
    known = ["--bim", write_plan(tmp_path / "plan.json", 2.7)] if planned else []
    done = process("--scan-dir", scans, "--out", tmp_path / "out", *known)
    assert done.returncode == 0
    found = [said in line and "multiply them by 0.3048" in line for line in told(done, tmp_path / "out")]
    assert found.count(True) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height", "carried", "planned"),
    [
        pytest.param(2.7, 1.4, None, marks=pytest.mark.long),
        pytest.param(9.0, 1.4, None, marks=pytest.mark.long),
        (9.0, 1.4, 2.7),
        (9.0, 2.4, None),
        pytest.param(9.0, 2.4, 9.0, marks=pytest.mark.long),
    ],
)
def test_metres_are_not_taken_for_feet_in_a_room_nor_in_a_hall(
    height: float, carried: float, planned: float | None, tmp_path: Path
) -> None:
    scans = write_walk(tmp_path / "scans", height, carried)
    known = [] if planned is None else ["--bim", write_plan(tmp_path / "plan.json", planned)]
    done = called("sgslam.run", "--single-pass", "--scan-dir", scans, "--out", tmp_path / "out", *known)
    assert done.returncode == 0 and not any("0.3048" in line for line in advice_of(tmp_path / "out"))


@pytest.mark.slow
def test_a_truth_of_another_drive_is_noted(tmp_path: Path) -> None:
    def way(bend: float) -> list[Array]:
        return [pose(0.1 * k - 1, 0.5 + bend * np.sin(k / 8), 1.4, 0.2) for k in range(25)]

    scene = scene_of(room(-5, -4, 5, 4, 2.7))
    (scans := tmp_path / "scans").mkdir()
    for k, T_room_sensor in enumerate(way(0.5)):
        np.save(scans / f"{k}.npy", scan(scene, T_room_sensor, SENSOR, seed=k))
    notes = {}
    for name, bend in (("own", 0.5), ("other", -1.5)):
        truth = Trajectory(np.arange(25) * 100_000_000, np.array(way(bend)))
        truth.write_tum(tmp_path / f"{name}.tum")
        out = tmp_path / name
        known = ("--ground-truth", tmp_path / f"{name}.tum", "--out", out)
        done = called("sgslam.run", "--single-pass", "--scan-dir", scans, *known)
        assert done.returncode == 0, done.stderr
        notes[name] = json.loads((out / "metrics.json").read_text())["accuracy"].get("note", "")
    assert "does the truth belong to this drive?" in notes["other"] and not notes["own"]
