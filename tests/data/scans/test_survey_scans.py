"""LAS and LAZ files that laspy wrote and E57 files that pye57 wrote, whole and cut off."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.plans import load_bim
from data.scans import ScanFolder
from data.scans.formats import read_points
from data.scans.reading_errors import UnreadableScanError
from data.scans.sources import open_scans

laspy, pye57 = pytest.importorskip("laspy"), pytest.importorskip("pye57")
POINTS = np.random.default_rng(0).normal(size=(300, 3)) * 5
SECONDS = np.linspace(0, 0.099, 300)


def write_las(path: Path, points: NDArray[np.float64], timed: bool = True, version: str = "1.2") -> None:
    header = laspy.LasHeader(point_format=1 if timed else 0, version=version)
    header.scales, header.offsets = np.full(3, 1e-4), np.zeros(3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    if timed:
        las.gps_time = 345_678.0 + SECONDS[: len(points)]
    las.write(path)


@pytest.mark.parametrize("suffix", [".las", ".laz", ".LAZ"])
@pytest.mark.parametrize("timed", [True, False])
def test_las_and_laz(suffix: str, timed: bool, tmp_path: Path) -> None:
    for k in range(3):
        write_las(tmp_path / f"{k}{suffix}", POINTS + k, timed, "1.4" if k else "1.2")
    scans = list(ScanFolder(tmp_path))
    for k, scan in enumerate(scans):
        np.testing.assert_allclose(scan.points, POINTS + k, atol=1e-4)
        if timed:
            assert scan.point_times is not None
            np.testing.assert_allclose(scan.point_times, SECONDS, atol=1e-6)
    assert len(scans) == 3 and (timed or scans[0].point_times is None)


def test_times_of_las_in_an_extra_dimension(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=0, version="1.4")
    header.add_extra_dim(laspy.ExtraBytesParams(name="Scalar_GpsTime", type=np.float64))
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T
    las["Scalar_GpsTime"] = SECONDS
    las.write(tmp_path / "0.laz")
    (scan,) = ScanFolder(tmp_path)
    assert scan.point_times is not None and np.allclose(scan.point_times, SECONDS)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_cut_anywhere_is_unreadable(suffix: str, tmp_path: Path) -> None:
    write_las(tmp_path / f"a{suffix}", POINTS)
    whole = (tmp_path / f"a{suffix}").read_bytes()
    for length in (0, 10, 200, 230, len(whole) // 2, len(whole) - 30):
        (tmp_path / f"a{suffix}").write_bytes(whole[:length])
        with pytest.raises(UnreadableScanError):
            read_points(tmp_path / f"a{suffix}")


def write_e57(path: Path, scans: list[NDArray[np.float64]], poses: list[Any] | None = None) -> Path:
    file = pye57.E57(str(path), mode="w")
    for k, points in enumerate(scans):
        data = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), points.T, strict=True))
        rotation, translation = (None, None) if poses is None else poses[k]
        file.write_scan_raw(data, rotation=rotation, translation=translation)
    file.close()
    return path


def test_e57_with_poses(tmp_path: Path) -> None:
    """The points come in the scanner's frame, the poses beside them."""
    half = np.sqrt(0.5)
    poses = [(np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 0])), (np.array([half, 0, 0, half]), np.array([1.0, 2, 3]))]
    source = open_scans(write_e57(tmp_path / "two.e57", [POINTS, POINTS + 1], poses))
    first, second = source
    np.testing.assert_allclose(first.points, POINTS)
    np.testing.assert_allclose(second.points, POINTS + 1)
    assert second.T_odom_sensor is not None
    np.testing.assert_allclose(second.T_odom_sensor @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-12)
    assert source.note is not None and second.stamp_ns == 100_000_000


def test_e57_without_poses(tmp_path: Path) -> None:
    source = open_scans(write_e57(tmp_path / "a.e57", [POINTS, np.zeros((4, 3)), *[POINTS] * 5]))
    assert [s.T_odom_sensor for s in source] == [None] * 6
    assert [s.index for s in source.skipped] == [1]


def write_fields(path: Path, columns: dict[str, NDArray[np.float64]], moved: list[float]) -> Path:
    """Scans of the same fields, with poses that have a translation along x and no rotation, by libE57 itself."""
    lib, file = pye57.libe57, pye57.E57(str(path), mode="w")
    image = file.image_file
    for x in moved:
        node, pose, at, kinds = (lib.StructureNode(image) for _ in range(4))
        for axis, value in zip("xyz", (x, 0.0, 0.0), strict=True):
            at.set(axis, lib.FloatNode(image, value))
        node.set("pose", pose)
        pose.set("translation", at)
        buffers = lib.VectorSourceDestBuffer()
        for name, values in columns.items():
            kinds.set(name, lib.FloatNode(image, 0.0, lib.E57_DOUBLE, -1e9, 1e9))
            buffers.append(lib.SourceDestBuffer(image, name, values, len(values), True, True))
        points = lib.CompressedVectorNode(image, kinds, lib.VectorNode(image, True))
        node.set("points", points)
        file.data3d.append(node)
        points.writer(buffers).write(len(POINTS))
    file.close()
    return path


@pytest.mark.parametrize("system", ["cartesian", "spherical"])
def test_e57_with_times_and_poses_without_rotation(system: str, tmp_path: Path) -> None:
    reach = np.linalg.norm(POINTS, axis=1)
    columns = {f"cartesian{axis}": np.ascontiguousarray(POINTS[:, k]) for k, axis in enumerate("XYZ")}
    if system == "spherical":
        columns = {
            "sphericalRange": reach, "sphericalAzimuth": np.arctan2(POINTS[:, 1], POINTS[:, 0]),
            "sphericalElevation": np.arcsin(POINTS[:, 2] / reach),
        }  # fmt: skip
    columns |= {f"{system}InvalidState": (np.arange(300) % 100 == 0).astype(float), "timeStamp": SECONDS}
    scans = list(open_scans(write_fields(tmp_path / "a.e57", columns, [0.0, 1.5])))
    good = np.arange(300) % 100 != 0
    for scan, x in zip(scans, (0.0, 1.5), strict=True):
        np.testing.assert_allclose(scan.points, POINTS[good], atol=1e-12)
        assert scan.dropped == 3 and scan.point_times is not None and scan.T_odom_sensor is not None
        np.testing.assert_allclose(scan.point_times, SECONDS[good])
        np.testing.assert_allclose(scan.T_odom_sensor, [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_broken_e57_is_one_line(tmp_path: Path) -> None:
    whole = write_e57(tmp_path / "a.e57", [POINTS]).read_bytes()
    for name, content in {"b": whole[:-500], "c": b"", "d": whole[:100], "e": b"ASTM-E57" + bytes(2000)}.items():
        (tmp_path / f"{name}.e57").write_bytes(content)
        with pytest.raises(UserError, match="E57") as told:
            open_scans(tmp_path / f"{name}.e57")
        assert "\n" not in str(told.value)
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0x55
    (tmp_path / "f.e57").write_bytes(damaged)
    with pytest.raises(UserError):
        list(open_scans(tmp_path / "f.e57"))


@pytest.mark.parametrize(
    ("module", "name", "install"),
    [("laspy", "a.las", "sgslam[scans]"), ("pye57", "a.e57", "sgslam[scans]"), ("ezdxf", "a.dxf", "sgslam[dxf]")],
)
def test_a_missing_library_is_named_with_how_to_install_it(
    module: str, name: str, install: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # as if it were not installed
    (tmp_path / name).write_bytes(b"anything")
    with pytest.raises(UserError, match=re.escape(f"pip install '{install}'")):
        if name == "a.dxf":
            load_bim(tmp_path / name)
        else:
            list(open_scans(tmp_path if name == "a.las" else tmp_path / name))
