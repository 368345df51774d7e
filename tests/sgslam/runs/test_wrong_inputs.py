"""Wrong input, as a user gives it: each is recognised, and told in one line that says what to do."""

import json
from pathlib import Path

import numpy as np
import pytest
from bag_files import lidar_bag
from boxes import Array, pose, room, scan, scene_of
from commands import called
from g2o_files import drawn_graph
from slam_outputs import slam_output, write_poses
from small_ifc import write_small_ifc

from data.simulation import Sensor

SENSOR = Sensor(azimuths=240, beams=32, lowest_deg=-45, highest_deg=45)
COUNT = 25  # scans
EMPTY_IFC = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n#1=IFCCARTESIANPOINT((0.,0.,0.));\nENDSEC;\nEND-ISO-10303-21;\n"
)


def write_walk(folder: Path) -> Path:
    """Scans of a room, from a sensor that is carried through it at 1 m/s, 0.1 s apart."""
    scene = scene_of(room(-5, -4, 5, 4, 2.7))
    folder.mkdir()
    for k in range(COUNT):
        np.save(folder / f"{k}.npy", scan(scene, pose(-1.0 + 0.1 * k, 0.5, 1.4, 0.2), SENSOR, seed=k))
    return folder


def write_changed(
    walk: Path, folder: Path, scale: float = 1.0, shift: float = 0.0, step: float | None = 0.1, count: int = COUNT
) -> Path:
    """The scans of a walk, the first `count` of them scaled and shifted (m), with stamps `step` apart."""
    folder.mkdir(parents=True)
    for k in range(COUNT):
        points: Array = np.load(walk / f"{k}.npy")
        np.save(folder / f"{k}.npy", points if k >= count else scale * points + [shift, -shift, 0.0])
    if step is not None:
        (folder / "times.txt").write_text("".join(f"{step * k:.9g}\n" for k in range(COUNT)))
    return folder


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_walk(tmp_path_factory.mktemp("walk") / "walk")


@pytest.fixture(scope="module")
def inputs(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of wrong inputs, and of right ones to give them with."""
    folder = tmp_path_factory.mktemp("inputs")
    write_changed(walk, folder / "scans")
    write_changed(walk, folder / "millimetres", scale=1000.0)
    write_changed(walk, folder / "world", shift=300.0)
    for unit, step in (("ms", 100.0), ("back", -0.1)):
        write_changed(walk, folder / f"scans_{unit}", step=step)
    (write_changed(walk, folder / "few_times") / "times.txt").write_text("0.0\n0.1\n")
    write_changed(walk, folder / "above/10th/points")
    write_changed(walk, folder / "above/second")
    (folder / "nothing").mkdir()
    (folder / "nan").mkdir()
    for k in range(3):
        np.save(folder / f"nan/{k}.npy", np.full((50, 3), np.nan))
    ifc = write_small_ifc(folder / "small.ifc").path
    (folder / "bad.ifc").write_text("this is not IFC")
    (folder / "bare.ifc").write_text(EMPTY_IFC)
    (folder / "cut.ifc").write_bytes(ifc.read_bytes()[:-500])
    (folder / "empty.json").write_text("{}")
    (folder / "wrong.yaml").write_text("keyframes: {distanse: 1.0}")
    (folder / "late.tum").write_text("1000.0 0 0 0 0 0 0 1\n1000.1 0 0 0 0 0 0 1\n")
    write_poses(slam_output().keyframes, folder, "tum")
    write_poses(slam_output().keyframes, folder, "kitti")
    (folder / "times.txt").unlink()
    (slam_output().write_clouds(folder / "clouds") / "000000.npy").unlink()
    drawn_graph().write(folder)
    lidar_bag(folder / "lidar.mcap", "mcap", 2)
    return folder


RUN, BIM = "sgslam.run --scan-dir scans", "sgslam.run --scan-dir scans --bim"
ANCHOR, LIVE, VIEW = "sgslam.other_slam.anchor", "sgslam.live", "sgslam.cli.view"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("sgslam.run --scan-dir above", "10th/points|second; give one of these"),
        ("sgslam.run --scan-dir few_times", "times.txt|25|2"),
        ("sgslam.run --scan-dir scans_back", "24 of 25 scans have wrong stamps"),
        ("sgslam.run --scan-dir scans_ms", "seem to be in another unit; give seconds"),
        ("sgslam.run --scan-dir nan", "NaN"),
        ("sgslam.run --scan-dir millimetres", "divide millimetres by 1000"),
        ("sgslam.run --scan-dir world", "in one world frame"),
        (f"{BIM} bad.ifc", "bad.ifc|IFC"),
        (f"{BIM} bare.ifc", "bare.ifc|walls"),
        (f"{BIM} cut.ifc", "cut.ifc|cut off"),
        (f"{BIM} small.ifc --storey attic", "attic|there are"),
        (f"{RUN} --set odometry.voxl_size=1", "odometry.voxl_size|odometry.voxel_size"),
        (f"{RUN} --set odometry.voxel_size=-1", "odometry.voxel_size"),
        (f"{RUN} --config wrong.yaml", "distanse|keyframes.distance"),
        (f"{RUN} --start 1,2", "X,Y,YAW"),
        (f"{RUN} --start 1,2,90", "radians|90 degrees are 1.5708"),
        (f"{RUN} --start 1,2,-6.28", "--bim"),
        (f"{RUN} --ground-truth late.tum", "late.tum"),
        (f"{RUN} --frobnicate", "--frobnicate"),
        ("sgslam.run --scan-dirs scans", "--scan-dirs|did you mean --scan-dir?"),
        ("sgslam.run --demo --storey attic", "attic|there are: Ground floor"),
        (f"{RUN} --demo", "leave out --scan-dir"),
        ("sgslam.run --resume nothing", "no run state"),
        ("sgslam.run --scan-dir lidar.mcap --imu lidar.mcap --imu-topic /points", "contains no IMU samples"),
        (f"{ANCHOR} poses.tum --bim small.ifc", "give --scans"),
        (f"{ANCHOR} none --bim small.ifc", "none: no such file or folder"),
        (f"{ANCHOR} poses.tum --scans clouds", "--bim is missing"),
        (f"{ANCHOR} nothing --bim small.ifc", "not KISS-SLAM's folder"),
        (f"{ANCHOR} poses.kitti --scans clouds --bim small.ifc", "poses for the"),
        (f"{ANCHOR} graph.g2o --bim plan.json", "give --scans"),
        (f"{LIVE} -", "MCAP on standard input is no longer read"),
        (f"{LIVE} scans --bim empty.json", "empty.json"),
        (f"{LIVE} none", "none: does not exist"),
        (f"{LIVE} scans --idle 0", "--idle"),
        ("sgslam.cli.inspect_bim small.ifc --maps 0", "--maps"),
        ("data.simulate --bim small.ifc --storey Ground --storey attic", "no storey 'attic'"),
        ("data.simulate --bim small.ifc --storey Ground --storey Ground", "there is no stair"),
        ("sgslam.cli.batch none.csv", "none.csv: cannot be read"),
        (f"{VIEW} nothing", "no run's folder"),
        ("sgslam.cli.export --out nothing --format ply", "no run's folder"),
        ("sgslam.cli.export --out nothing", "--format is missing|kitti"),
        ("sgslam.as_built.compare nothing nothing", "no elements.json"),
    ],
)
def test_a_mistake_is_told_in_one_line_and_nothing_is_written(
    line: str, said: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`said`: parts of the line."""
    monkeypatch.chdir(inputs)
    command, *words = line.split()
    if not any(own in line for own in ("batch", "view", "export", "compare", "--resume")):
        words += ["--out", str(tmp_path / "out")]
    before = sorted(inputs.rglob("*"))
    done = called(command, *words)
    assert done.returncode == 2, done.stderr
    (error,) = (own for own in done.stderr.splitlines() if own.startswith("error: "))
    assert done.stderr.splitlines()[-1] == error and "Traceback" not in done.stderr
    assert [part for part in said.split("|") if part not in error] == [], error
    assert sorted(inputs.rglob("*")) == before
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def advice(out: Path, *words: object) -> list[str]:
    """What a run advises: in the metrics, the terminal and the report."""
    done = called("sgslam.run", "--single-pass", *words, "--out", out)
    assert done.returncode == 0, done.stderr
    lines: list[str] = json.loads((out / "metrics.json").read_text())["advice"]
    report = (out / "report.html").read_text()
    for line in lines:
        assert line in done.stderr and line.replace("'", "&#39;") in report
    return lines


@pytest.mark.slow
def test_odd_scans_are_advised_of_and_left_out(walk: Path, tmp_path: Path) -> None:
    scans = write_changed(walk, tmp_path / "scans", shift=300.0, step=None, count=2)  # two odd ones prove nothing
    (scans / "7.npy").write_bytes(b"no scan")
    told = advice(tmp_path / "out", "--scan-dir", scans)
    assert any("7.npy: skipped" in line for line in told) and any("0.1 s apart" in line for line in told)
