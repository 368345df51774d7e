"""Every point of the map against the planned face that it was measured on; Open3D's clouds as scans."""

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import refused
from drives import small_drive
from numpy.typing import NDArray

from data.plans.elements import PlannedElement
from sgslam.as_built.elements.files import PICTURES
from sgslam.cloud_to_model import distances_to_model, load_open3d
from sgslam.cloud_to_model.files import CLOUD, HISTOGRAM, TABLE, write_cloud_to_model
from sgslam.slam import SceneGraphSlam

Array = NDArray[np.float64]
needs_open3d = pytest.mark.skipif(find_spec("open3d") is None, reason="needs the extra open3d")
ORIGIN = np.array([500_000.0, 4_000_000.0, 100.0])  # a site in national coordinates


def wall(inwards: bool = False) -> PlannedElement:
    """With the normals of its faces outwards or inwards."""
    box = trimesh.creation.box(bounds=[(3.0, -2.0, 0.0), (3.2, 2.0, 2.6)])
    triangles = np.asarray(box.triangles) + ORIGIN
    return PlannedElement("w1", "IfcWall", "Wall", "EG", "solid", triangles[:, ::-1] if inwards else triangles)


def seen_from_the_left(offset: float) -> tuple[Array, Array]:
    """Points where the wall's left face would be, moved by `offset` along x, and the way to a sensor at x = 0."""
    y, z = np.meshgrid(np.linspace(-1.5, 1.5, 20), np.linspace(0.4, 2.0, 20))
    points = np.column_stack([np.full(y.size, 3 + offset), y.ravel(), z.ravel()])
    towards = np.array([0.0, 0.0, 1.2]) - points
    return points + ORIGIN, towards / np.linalg.norm(towards, axis=1, keepdims=True)


@needs_open3d
@pytest.mark.parametrize("inwards", [False, True])
@pytest.mark.parametrize("offset", [-0.25, 0.02, 0.25])
def test_the_distance_is_from_the_face_that_the_sensor_saw(offset: float, inwards: bool) -> None:
    """Also where the wall stands off by more than its thickness, and whichever way the model turns its faces."""
    found = distances_to_model(*seen_from_the_left(offset), [wall(inwards)], 0.3)
    np.testing.assert_allclose(found.distance, -offset, atol=1e-4)
    assert found.compared.all() and set(found.side) == {3}  # towards -x
    opening = PlannedElement("d1", "IfcDoor", "Door", "EG", "opening", wall().triangles)
    for elements, reach in (([wall(inwards)], 0.01), ([opening], 0.3)):
        assert not distances_to_model(*seen_from_the_left(offset), elements, reach).compared.any()


@needs_open3d
def test_the_files_say_the_same(tmp_path: Path) -> None:
    near, towards = seen_from_the_left(0.02)
    far, _ = seen_from_the_left(-1.0)
    found = distances_to_model(np.concatenate([near, far]), np.concatenate([towards, towards]), [wall()], 0.3)
    paths = write_cloud_to_model(tmp_path, found, [wall()], 0.03)
    assert paths == [tmp_path / name for name in (CLOUD, TABLE, HISTOGRAM, PICTURES)]
    told = json.loads((tmp_path / TABLE).read_text())
    assert (told["points"], told["compared"]) == (2 * len(near), len(near))
    assert told["percentiles_m"]["50"] == told["mean_m"] == pytest.approx(-0.02, abs=2e-4)
    assert told["within_tolerance"] == 1.0 and sum(told["histogram"]["points"]) == len(near)
    (element,) = told["elements"]
    assert (element["global_id"], element["points"]) == ("w1", len(near))
    assert (tmp_path / element["heat_map"]).read_bytes().startswith(b"\x89PNG")
    cloud = trimesh.load(tmp_path / CLOUD)
    np.testing.assert_allclose(np.asarray(cloud.vertices), found.points, atol=1e-6)
    kept = cloud.metadata["_ply_raw"]["vertex"]["data"]["distance"]
    np.testing.assert_allclose(kept, found.distance, atol=1e-6)


@needs_open3d
def test_a_scan_as_a_cloud() -> None:
    o3d = load_open3d()
    stamp, points = next(iter(small_drive().scans))
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    poses = [SceneGraphSlam().add_scan(stamp, given).T_map_sensor for given in (points, cloud)]
    np.testing.assert_array_equal(poses[0], poses[1])


def test_without_the_model_or_the_library_the_export_is_refused(anchored_run: Path) -> None:
    words = ("sgslam.cli.export", "--out", anchored_run / "out", "--format", "cloud-to-model")
    assert "--bim" in refused(*words)
    if find_spec("open3d") is None:
        assert "pip install 'sgslam[open3d]'" in refused(*words, "--bim", anchored_run / "small.ifc")
