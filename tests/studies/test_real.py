"""The study of recordings of real buildings: simulated drives laid out as the data sets are, and what is not whole."""

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from bag_files import cloud, store, write_bag
from commands import refused
from drives import ROBOT, SENSOR
from scipy.spatial.transform import Rotation
from slabim_form import SESSION, write_slabim
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from data.scans import ScanFolder
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds
from evaluation.__main__ import _studies, main
from evaluation.harness.row_file import read_rows, rows_path
from evaluation.harness.study import load_study
from evaluation.studies.real.hilti import POINTS
from evaluation.studies.real.known import data_set_in
from evaluation.studies.real.study import Choice, End, Measured, Recorded, cases, measure
from evaluation.studies.real.tables import claims, tables
from evaluation.studies.real.whole_files import defect

T0 = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def slabim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_slabim(tmp_path_factory.mktemp("slabim"))


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one's own: a plan, scans, poses and the list."""
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "plan.ifc", site=(300.0, -200.0, 4.0), yaw=0.5)
    run = simulate(building.path, "Ground", folder / "run", seed=3, min_rooms=3, min_length=20.0, sensor=SENSOR,
                   robot=ROBOT, scan_format="pcd")  # fmt: skip
    shutil.move(folder / "run/scans", folder / "scans")
    run.truth.write_tum(folder / "truth.tum")
    (folder / "sequences.yaml").write_text("- {name: small, bim: plan.ifc, scans: scans, truth: truth.tum}\n")
    return folder


def measured(folder: Path, work: Path, submap_m: float | None = None) -> list[tuple[Recorded, Measured]]:
    submaps = () if submap_m is None else (submap_m,)
    found = cases(Choice(dataset=folder, submaps=submaps))
    return [(case, measure(case, work)) for case in found if case.submap_m == submap_m]


@pytest.mark.slow
def test_a_recording_of_ones_own_is_measured(own: Path, tmp_path: Path) -> None:
    ((case, record),) = measured(own, tmp_path)
    assert (case.dataset, case.sequence, record.runs, record.anchored) == ("own recordings", "small", 1, 1)
    assert record.scans == record.true and record.unreadable == 0 and record.fine > 0.9 * record.true
    assert record.rmse_m is not None and record.rmse_m < 0.05 and record.ends[0].position_m < 0.05
    assert record.aligned_rmse_m is not None and record.aligned_rmse_m < 0.05


@pytest.mark.slow
def test_a_session_in_the_form_of_slabim_is_measured_and_its_rows_are_kept(
    slabim: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "real", "--quick", "--dataset", str(slabim), "--rows", str(tmp_path), "--work", str(tmp_path / "w")]
    assert main(words) == 0
    (row,) = read_rows(rows_path(tmp_path / "quick", "real"))
    assert row.case["dataset"] == "SLABIM" and row.case["sequence"] == SESSION
    assert row.record["true"] == row.record["scans"] > 15
    assert main(words) == 0
    assert "1 cases, 0 to compute" in capsys.readouterr().out
    assert main(["render", "--rows", str(tmp_path / "quick")]) == 0
    assert f"| SLABIM | {SESSION} | 1/1 | 1/1 | 1/1 | 100.0% |" in (tmp_path / "quick/real.md").read_text()


@pytest.mark.long
@pytest.mark.slow
def test_pieces_of_the_way_are_run_on_their_own(own: Path, tmp_path: Path) -> None:
    ((case, record),) = measured(own, tmp_path, 8.0)
    truth = Trajectory.read_tum(own / "truth.tum")
    way = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1).sum()
    assert record.runs == way // 8.0 >= 2 and len(record.ends) == record.anchored <= record.runs
    assert record.scans == len(truth) and record.aligned_rmse_m is None
    line = tables(rows_of([(case, record)]))["submaps"].iloc[0]
    assert line["length (m)"] == 8.0 and line["pieces"] == str(record.runs)


@pytest.mark.slow
def test_the_form_of_hilti_2021_is_measured_after_alignment(own: Path, tmp_path: Path) -> None:
    """A point of the carrier was surveyed, in a frame of its own; the sensor hangs turned under the IMU."""
    scans, truth = list(ScanFolder(own / "scans")), Trajectory.read_tum(own / "truth.tum")
    types = store(ros1=True)
    clouds = [cloud(types, scan.points.astype(np.float32), T0 + scan.stamp_ns) for scan in scans]
    times = [T0 + scan.stamp_ns for scan in scans]
    write_bag(tmp_path / "Basement_4.bag", "ros1", {"/os_cloud_node/points": list(zip(times, clouds, strict=True))})
    turn, shift = Rotation.from_euler("x", 180, degrees=True), np.array([0.02, -0.01, 0.13])
    extrinsics = {"translation": shift.tolist(), "quaternion": turn.as_quat().tolist()}
    none = {"translation": [0, 0, 0], "quaternion": [0, 0, 0, 1]}
    sensors = {"os_lidar": {"extrinsics": extrinsics}, "os_sensor": {"extrinsics": none}}
    (tmp_path / "calibration.yaml").write_text(str({"sensors": sensors}))
    point = turn.inv().apply(np.array(POINTS["prism"]) - shift)
    places = (truth.poses @ np.append(point, 1.0))[::7, :3] + [1000.0, 1000.0, 100.0]
    lines = zip(truth.stamps_ns[::7].tolist(), places.tolist(), strict=True)
    text = "".join(f"{ns_to_seconds(T0 + t)} {x} {y} {z} 0 0 0 1\n" for t, (x, y, z) in lines)
    (tmp_path / "Basement_4_prism.txt").write_text(text)
    ((case, record),) = measured(tmp_path, tmp_path / "work")
    assert case.dataset == "Hilti 2021" and case.submap_m is None and record.anchored == 0
    assert record.aligned_rmse_m is not None and record.aligned_rmse_m < 0.05
    rows = rows_of([(case, record)])
    assert claims(rows) == [] and not tables(rows)["datasets"].iloc[0]["within 3 m, 5 deg"]


def test_the_form_of_conslam_is_recognised_and_checked(own: Path, tmp_path: Path) -> None:
    (tmp_path / "sequence_2").symlink_to(own / "scans")
    with pytest.raises(UserError, match="0 IFC files in it; put the one of 'ConSLAM BIM and GT Poses'"):
        cases(Choice(dataset=tmp_path))
    shutil.copy(own / "plan.ifc", tmp_path)
    with pytest.raises(UserError, match=r"sequence_2\.txt: is missing; download it from 'ConSLAM BIM"):
        cases(Choice(dataset=tmp_path))
    shutil.copy(own / "truth.tum", tmp_path / "sequence_2.txt")
    found = cases(Choice(dataset=tmp_path))
    assert [(case.dataset, case.sequence, case.submap_m) for case in found] == [
        ("ConSLAM", "sequence_2", length) for length in (None, 15.0, 30.0)
    ]
    recording = data_set_in(tmp_path).open("sequence_2", tmp_path)
    assert len(recording.scans) == len(recording.truth)
    assert recording.plan is not None and len(recording.plan.rooms) == 3


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("walls.ply", None, "walls.ply: is missing; download BIM.zip"),
        ("walls.ply", b"", "walls.ply: is empty"),
        ("data/3.pcd", "cut", r"3\.pcd: is cut off: \d+ of \d+ bytes; download sensor_data/3F_Region1.zip"),
        ("pose_frame_to_bim.txt", None, "pose_frame_to_bim.txt: is missing"),
    ],
)
def test_what_of_slabim_is_missing_or_cut_off_is_said(
    slabim: Path, tmp_path: Path, name: str, content: bytes | str | None, message: str
) -> None:
    root = tmp_path / "SLABIM"
    shutil.copytree(slabim, root)
    (path,) = [path for path in root.rglob(Path(name).name) if path.as_posix().endswith(name)]
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content if isinstance(content, bytes) else path.read_bytes()[:-40])
    with pytest.raises(UserError, match=message):
        cases(Choice(dataset=root))


def test_an_archive_that_is_not_complete_is_said(tmp_path: Path) -> None:
    (tmp_path / "sensor_data").mkdir()
    with pytest.raises(UserError, match=r"no session .* download sensor_data/3F_Region1.zip"):
        cases(Choice(dataset=tmp_path))
    (tmp_path / "sensor_data/5F_Region2.zip").write_bytes(b"PK")
    with pytest.raises(UserError, match=r"5F_Region2.zip has 2 of 6,470,000,000 bytes: complete its download"):
        cases(Choice(dataset=tmp_path))
    (tmp_path / "sensor_data/5F_Region9.zip").write_bytes(b"PK")
    (tmp_path / "sensor_data/5F_Region2.zip").unlink()
    with pytest.raises(UserError, match=r"unpack sensor_data/5F_Region9.zip here"):
        cases(Choice(dataset=tmp_path))


def test_bags_plans_and_other_files_that_are_cut_off(own: Path, tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text("{}")
    (tmp_path / "Basement_1_pole.txt").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(UserError, match=r"download Basement_1\.bag"):
        cases(Choice(dataset=tmp_path))
    bag = b"#ROSBAG V2.0\n" + struct.pack("<II", 69, 18) + b"index_pos=" + struct.pack("<Q", 10**6)
    (tmp_path / "Basement_1.bag").write_bytes(bag)
    with pytest.raises(UserError, match=rf"Basement_1\.bag: is cut off: {len(bag)} of 1000001 bytes"):
        cases(Choice(dataset=tmp_path))
    copy = tmp_path / "own"
    shutil.copytree(own, copy)
    (copy / "plan.ifc").write_bytes((copy / "plan.ifc").read_bytes()[:-200])
    with pytest.raises(UserError, match=r"plan\.ifc: is cut off.*correct the paths of 'small'"):
        cases(Choice(dataset=copy))


def test_mistakes_are_one_line(own: Path, tmp_path: Path) -> None:
    run = ("evaluation", "run", "real", "--rows", tmp_path / "rows")
    assert "--dataset DIR" in refused(*run)
    assert "no such folder" in refused(*run, "--dataset", tmp_path / "none")
    assert "add sequences.yaml" in refused(*run, "--dataset", tmp_path)
    assert "there are: small" in refused(*run, "--dataset", own, "--set", "sequences=[large]")
    assert "real" not in [study.name for study in _studies(["all"])] and load_study("real").brought
    assert "loops has no option 'dataset'" in refused("evaluation", "run", "loops", "--dataset", own)
    (tmp_path / "data/floor_1/2025-05-05/run_1").mkdir(parents=True)
    told = refused(*run, "--dataset", tmp_path)
    assert "Hilti-Trimble 2026 cannot be run" in told and "no LiDAR scans" in told


def test_runs_that_are_not_anchored_are_no_success() -> None:
    given = {"scans": 100, "unreadable": 0, "true": 100, "reason": "", "rmse_m": 0.1, "yaw_rmse_deg": 0.2,
             "aligned_rmse_m": 0.05}  # fmt: skip

    def row(name: str, submap_m: float | None, runs: int, *ends: tuple[float, float]) -> tuple[Recorded, Measured]:
        found = tuple(End(position_m=m, yaw_deg=degrees) for m, degrees in ends)
        case = Recorded(dataset="SLABIM", folder="f", sequence=name, topic=None, submap_m=submap_m)
        return case, Measured(runs=runs, anchored=len(ends), ends=found, coarse=90, fine=50, **given)

    rows = rows_of([row("a", None, 1, (0.2, 0.9)), row("b", None, 1, (2.9, 4.9)), row("c", None, 1),
                    row("a", 15.0, 4, (0.1, 1.1), (0.1, 0.1), (9.0, 0.1))])  # fmt: skip
    line, pieces = tables(rows)["datasets"].iloc[0], tables(rows)["submaps"].iloc[0]
    assert (line["anchored"], line["within 3 m, 5 deg"], line["within 0.3 m, 1 deg"]) == ("2/3", "2/3", "1/3")
    assert line["scans within 3 m, 5 deg"] == "90.0%" and line["scans within 0.3 m, 1 deg"] == "50.0%"
    assert (pieces["anchored"], pieces["within 3 m, 5 deg"], pieces["within 0.3 m, 1 deg"]) == ("3/4", "2/4", "1/4")
    (claim,) = claims(rows)
    assert (claim.value, claim.cases) == ("1/3", "3 recordings")


@pytest.mark.parametrize("head", [b"", b"POINTS \n", b"POINTS many\nSIZE 4\n", b"POINTS 5\nSIZE 4 4\nCOUNT 1\n"])
def test_a_header_that_states_no_size_is_left_to_the_reader(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "0.pcd"
    path.write_bytes(head + b"DATA binary\n1234")
    assert defect(path) is None
    path.write_bytes(b"FIELDS x y z\nSIZE 4 4 4\nPOINTS 2\nDATA binary\n" + bytes(23))
    assert defect(path) == f"is cut off: {path.stat().st_size} of {path.stat().st_size + 1} bytes"
    for suffix in ("bag", "db3", "e57"):
        (tmp_path / f"short.{suffix}").write_bytes(b"ASTM-E57")
        assert defect(tmp_path / f"short.{suffix}") is None
