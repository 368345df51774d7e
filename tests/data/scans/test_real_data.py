"""The main job on a real building's model and on real scans, where they are at hand (../shared)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from commands import called

from data.scene_graph import SceneGraph, WallSurface
from data.simulation import SpinningSensor
from data.simulation.simulate import simulate
from data.trajectory import Trajectory

pytestmark = [pytest.mark.slow, pytest.mark.long]

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
INSTITUTE = SHARED / "ifc" / "AC11-Institute-Var-2-IFC.ifc"
OFFICE = SHARED / "ifc" / "Office_A_20110811.ifc"
VLP16 = SHARED / "scans" / "vlp16_room_corridor"
BEGUN = 700  # scans: half a minute through several rooms


def run(*arguments: str | Path) -> dict[str, Any]:
    """The metrics of a run whose output folder is the last argument."""
    done = called("sgslam.run", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads((Path(arguments[-1]) / "metrics.json").read_text())


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 120 m and 8 rooms on the Institute's ground floor, from a random start."""
    if not INSTITUTE.is_file():
        pytest.skip("the Institute's IFC file is not at ../shared")
    folder = tmp_path_factory.mktemp("institute") / "drive"
    simulate(INSTITUTE, "Erdgeschoss", folder, sensor=SpinningSensor(azimuths=900))
    return folder


def test_institute_is_anchored_on_the_right_storey(drive: Path, tmp_path: Path) -> None:
    metrics = run("--scan-dir", drive / "scans", "--bim", INSTITUTE, "--ground-truth", drive / "truth.tum",
                  "--out", tmp_path)  # fmt: skip
    assert metrics["anchored"], metrics["reason"]
    accuracy = metrics["accuracy"]
    assert accuracy["rmse_bim_m"] <= 0.05 and accuracy["matched_poses"] == accuracy["total_poses"]
    a_graph, s_graph = SceneGraph.load(tmp_path / "a_graph.json"), SceneGraph.load(tmp_path / "s_graph.json")
    matches = json.loads((tmp_path / "matches.json").read_text())
    assert [f.name for f in a_graph.floors if f.id == matches["floor"]] == ["Erdgeschoss"]
    T_bim_map = Trajectory.read_tum(drive / "truth.tum").poses[0]  # the sensor began level
    assert len(matches["rooms"]) >= 8
    for s_id, a_id, _ in matches["rooms"]:
        place = T_bim_map[:2, :2] @ s_graph.room_by_id[s_id].centroid + T_bim_map[:2, 3]
        assert shapely.Polygon(a_graph.room_by_id[a_id].polygon).contains(shapely.Point(place)), (s_id, a_id)


def test_another_building_is_never_anchored_to(drive: Path, tmp_path: Path) -> None:
    if not OFFICE.is_file():
        pytest.skip("the office's IFC file is not at ../shared")
    (begun := tmp_path / "scans").mkdir()
    for path in sorted((drive / "scans").glob("*.bin"))[:BEGUN]:
        (begun / path.name).symlink_to(path)
    times = (drive / "scans" / "times.txt").read_text().splitlines()[:BEGUN]
    (begun / "times.txt").write_text("\n".join(times) + "\n")
    metrics = run("--scan-dir", begun, "--bim", OFFICE, "--out", tmp_path / "out")
    assert metrics["scans"] == BEGUN and metrics["rooms"] >= 2
    assert not metrics["anchored"] and metrics["reason"] and metrics["T_bim_map"] is None


def test_real_scans_give_walls_and_no_jump(tmp_path: Path) -> None:
    if not VLP16.is_dir():
        pytest.skip("the VLP-16 scans are not at ../shared")
    run("--scan-dir", VLP16, "--out", tmp_path)
    walls = SceneGraph.load(tmp_path / "s_graph.json").wall_surfaces
    assert len(walls) >= 6
    assert not [(a.id, b.id) for i, a in enumerate(walls) for b in walls[i + 1 :] if same_place(a, b)]
    positions = Trajectory.read_tum(tmp_path / "trajectory.tum").positions
    assert len(positions) == 30
    assert np.linalg.norm(np.diff(positions[7:], axis=0), axis=1).max() < 1.5


def same_place(a: WallSurface, b: WallSurface) -> bool:
    """Within 0.1 m and 5 degrees over the same extent (0.1 m of it at least)."""
    normal = np.array(a.normal)
    if normal @ b.normal < np.cos(np.radians(5)) or abs((np.array(b.centroid) - a.centroid) @ normal) > 0.1:
        return False
    tangent = np.array([-normal[1], normal[0]])
    along_a, along_b = (np.sort(np.array(w.ends()) @ tangent) for w in (a, b))
    return bool(min(along_a[1], along_b[1]) - max(along_a[0], along_b[0]) > 0.1)
