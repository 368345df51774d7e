"""The command as a user calls it: the folder that it leaves, and what it makes of scans that are not all well."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import shapely
import yaml
from beginnings import begins_here
from boxes import pose, room, scan, scene_of
from commands import called, refused

from data.scene_graph import SceneGraph
from data.simulation import Sensor
from data.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[3]
SCHEMA = ROOT / "data" / "scene_graph" / "scene_graph.schema.json"
SHARED_SCHEMA = ROOT.parent / "shared" / "schemas" / "scene_graph.schema.json"


def contains(ours: Any, shared: Any) -> bool:
    """Whether a schema has all of another one; it may describe more."""
    if isinstance(shared, dict):
        return isinstance(ours, dict) and all(key in ours and contains(ours[key], own) for key, own in shared.items())
    return bool(ours == shared)


def test_a_run_leaves_the_folder_of_the_contract(anchored_run: Path) -> None:
    out = anchored_run / "out"
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["anchored"] and metrics["accuracy"]["rmse_bim_m"] < 0.03 and metrics["first_anchor_s"] > 0
    described = (ROOT / "docs" / "outputs.md").read_text()
    assert [key for key in metrics if f"`{key}`" not in described] == []
    stages = {"total", "reading", "odometry", "surfaces", "rooms", "matching", "optimisation", "smoothing", "report"}
    assert stages <= metrics["seconds"].keys()
    names = ("trajectory.tum", "trajectory_map.tum", "trajectory_odometry.tum", "trajectory_live.tum")
    final, in_map, *_ = ways = [Trajectory.read_tum(out / name) for name in names]
    assert {len(way) for way in ways} == {metrics["scans"]} and begins_here(in_map.poses[0])
    assert np.linalg.norm(final.poses[0][:3, 3] - metrics["T_bim_map"][:3]) < 1e-6
    assert "voxel_size" in yaml.safe_load((out / "config.yaml").read_text())["odometry"]
    assert "anchored: " in (out / "run.log").read_text()
    assert (out / "plan.png").read_bytes().startswith(b"\x89PNG")


def test_its_graphs_keep_the_schema_and_its_matches_are_of_what_was_seen(anchored_run: Path) -> None:
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    if SHARED_SCHEMA.is_file():
        assert contains(schema["properties"], json.loads(SHARED_SCHEMA.read_text())["properties"])
    graphs = [SceneGraph.load(anchored_run / "out" / f"{name}.json") for name in ("s_graph", "a_graph")]
    for name, frame in (("s_graph", "map"), ("a_graph", "bim")):
        graph = json.loads((anchored_run / "out" / f"{name}.json").read_text())
        jsonschema.validate(graph, schema)
        assert graph["frame"] == frame
    s, a = graphs
    matches = json.loads((anchored_run / "out/matches.json").read_text())
    assert matches["status"] == "unique" and len(matches["rooms"]) >= 3
    for s_id, a_id, confidence in matches["wall_surfaces"]:
        assert s_id in s.surface_by_id and a_id in a.surface_by_id and 0 <= confidence <= 1
    T = Trajectory.read_tum(anchored_run / "truth.tum").poses[0]
    for s_id, a_id, _ in matches["rooms"]:  # the map's frame is the first sensor pose, which is level
        place = T[:2, :2] @ s.room_by_id[s_id].centroid + T[:2, 3]
        assert shapely.contains_xy(shapely.Polygon(a.room_by_id[a_id].polygon), *place), (s_id, a_id)
    for deviation in json.loads((anchored_run / "out/deviations.json").read_text()):
        assert deviation["kind"] in ("moved", "absent", "extra")


@pytest.fixture(scope="module")
def points() -> list[np.ndarray]:
    """Twelve small scans of a box room, enough to run through."""
    scene, sensor = scene_of(room(-3, -2, 3, 2)), Sensor(azimuths=360)
    return [scan(scene, pose(0.02 * k, 0.0, 1.0), sensor, seed=k) for k in range(12)]


@pytest.fixture
def scans(points: list[np.ndarray], tmp_path: Path) -> Path:
    (tmp_path / "scans").mkdir()
    for k, own in enumerate(points):
        np.save(tmp_path / f"scans/{k}.npy", own)
    return tmp_path / "scans"


def test_without_a_plan_it_runs_through_and_strict_is_not_content(scans: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    stale = [tmp_path / "out" / name for name in ("deviations.bcf", "elements.json", "trajectory_all.tum")]
    for path in stale:
        path.write_text("of an earlier run in this folder, with a plan")
    done = called("sgslam.run", "--scan-dir", scans, "--out", tmp_path / "out", "--strict")
    assert done.returncode == 3 and "map only" in done.stdout and "--strict: exit code 3: map only" in done.stderr
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    assert metrics["anchored"] is False and metrics["reason"] == "no plan was given"
    assert (metrics["scans"], metrics["anchored_share"]) == (12, 0.0)
    assert not any(path.exists() for path in stale)
    assert "0.1 s apart" in done.stderr  # the stamps are a guess, which the user can read


@pytest.mark.parametrize(("bad", "skipped"), [(2, True), (4, False)])
def test_up_to_a_fifth_of_the_scans_may_be_bad(bad: int, skipped: bool, scans: Path, tmp_path: Path) -> None:
    """Of more, what was computed until then is there."""
    np.save(scans / "11.npy", np.full((100, 3), np.nan))
    for k in range(12 - bad, 11):
        (scans / f"{k}.npy").write_bytes(b"not numpy")
    words = ("sgslam.run", "--scan-dir", scans, "--out", tmp_path / "out", "--single-pass")
    done = called(*words)
    assert done.returncode == (0 if skipped else 2) and ("fifth" in done.stderr.splitlines()[-1]) != skipped
    assert len(Trajectory.read_tum(tmp_path / "out/trajectory.tum")) == 12 - bad


def test_config_of_a_run_repeats_it_and_a_mistake_leaves_its_results_alone(scans: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    words = ("sgslam.run", "--scan-dir", scans, "--single-pass")
    assert called(*words, "--out", first, "--set", "odometry.voxel_size=0.6").returncode == 0
    before = {file.name: file.read_bytes() for file in first.iterdir()}
    assert "none.ifc" in refused(*words, "--bim", tmp_path / "none.ifc", "--out", first)
    assert {file.name: file.read_bytes() for file in first.iterdir()} == before
    again = called(*words, "--out", second, "--config", first / "config.yaml")
    assert again.returncode == 0 and "overwritten" not in again.stderr
    for name in ("config.yaml", "trajectory.tum", "s_graph.json"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
    over = called(*words, "--out", second)
    assert [str(second) in line for line in over.stderr.splitlines() if "overwritten" in line] == [True]
