"""The command as a user calls it: the demo from end to end, and every mistake that a user can make."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from beginnings import begins_here
from commands import called
from small_ifc import write_small_ifc

from data.scene_graph import SceneGraph
from data.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[3]
SCHEMA = ROOT / "data" / "scene_graph" / "scene_graph.schema.json"
SHARED_SCHEMA = ROOT.parent / "shared" / "schemas" / "scene_graph.schema.json"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return called("sgslam.run", *arguments)


def process(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """As `run`, in a process of its own."""
    command = [sys.executable, "-m", "sgslam.run", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=900, check=False)


def assert_refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """A user's mistake: exit code 2 and one line that holds all the words."""
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1 and done.stderr.splitlines()[-1] == lines[0], done.stderr
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in lines[0], f"'{word}' is not in: {lines[0]}"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    done = process("--demo", "--strict", "--out", folder / "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"report: {folder / 'out' / 'report.html'}"
    return folder / "out"


@pytest.mark.slow
def test_demo_is_anchored_within_three_centimetres(demo: Path) -> None:
    metrics = json.loads((demo / "metrics.json").read_text())
    assert metrics["anchored"] is True
    accuracy = metrics["accuracy"]
    assert accuracy["rmse_bim_m"] < 0.03
    assert accuracy["matched_poses"] == accuracy["total_poses"] == metrics["scans"]
    described = (ROOT / "docs" / "formats.md").read_text()
    assert [key for key in metrics if f"`{key}`" not in described] == []
    stages = {"total", "reading", "odometry", "surfaces", "rooms", "matching", "optimisation", "smoothing", "report"}
    assert stages <= metrics["seconds"].keys()
    assert metrics["first_anchor_s"] > 0


@pytest.mark.slow
def test_demo_leaves_the_folder_of_the_contract(demo: Path) -> None:
    scans = json.loads((demo / "metrics.json").read_text())["scans"]
    final, in_map, odometry = (
        Trajectory.read_tum(demo / name) for name in ("trajectory.tum", "trajectory_map.tum", "trajectory_odometry.tum")
    )
    assert len(final) == len(in_map) == len(odometry) == scans
    assert begins_here(in_map.poses[0])
    T = np.array(json.loads((demo / "metrics.json").read_text())["T_bim_map"])
    assert np.linalg.norm(final.poses[0][:3, 3] - T[:3]) < 1e-6
    s_graph, a_graph = SceneGraph.load(demo / "s_graph.json"), SceneGraph.load(demo / "a_graph.json")
    assert s_graph.frame == "map" and a_graph.frame == "bim"
    matches = json.loads((demo / "matches.json").read_text())
    assert matches["status"] == "unique"
    for s_id, a_id, confidence in matches["wall_surfaces"]:
        assert s_id in s_graph.surface_by_id and a_id in a_graph.surface_by_id and 0 <= confidence <= 1
    for deviation in json.loads((demo / "deviations.json").read_text()):
        assert deviation["kind"] in ("moved", "absent", "extra")
    assert "voxel_size" in yaml.safe_load((demo / "config.yaml").read_text())["odometry"]
    assert "factors, anchor: " in (demo / "run.log").read_text()
    elements = json.loads((demo / "elements.json").read_text())["elements"]
    report = (demo / "report.html").read_text()
    assert f"of {len(elements)} planned elements seen" in report and "demo_building.ifc" in report
    assert all(f'data-element="{e["global_id"]}"' in report for e in elements if e["verdict"] == "moved")
    assert (demo / "plan.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_each_matched_room_is_the_one_that_was_seen(demo: Path) -> None:
    shapely = pytest.importorskip("shapely")
    s_graph, a_graph = SceneGraph.load(demo / "s_graph.json"), SceneGraph.load(demo / "a_graph.json")
    truth = Trajectory.read_tum(demo / "demo_drive" / "truth.tum").poses[0]
    matches = json.loads((demo / "matches.json").read_text())
    assert len(matches["rooms"]) >= 4
    for s_id, a_id, _ in matches["rooms"]:
        # the map's frame is the first sensor pose, which is level
        place = truth[:2, :2] @ s_graph.room_by_id[s_id].centroid + truth[:2, 3]
        polygon = a_graph.room_by_id[a_id].polygon
        assert polygon is not None and shapely.Polygon(polygon).contains(shapely.Point(place)), (s_id, a_id)


@pytest.mark.slow
def test_scene_graphs_keep_the_schema(demo: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    if SHARED_SCHEMA.is_file():
        assert schema == json.loads(SHARED_SCHEMA.read_text())
    for name in ("s_graph.json", "a_graph.json"):
        graph = json.loads((demo / name).read_text())
        jsonschema.validate(graph, schema)
        del graph["wall_surfaces"][0]["normal"]
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(graph, schema)


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve small scans of a box room, enough to run through."""
    folder = tmp_path_factory.mktemp("scans")
    for i in range(12):
        np.save(folder / f"{i}.npy", box_scan(i * 0.02))
    return folder


def box_scan(x: float) -> np.ndarray:
    """A 6 x 4 x 2.6 m room seen from 1 m height at (x, 0)."""
    azimuth, elevation = np.meshgrid(1e-3 + np.radians(np.arange(-180, 180)), np.radians(np.arange(-15, 16, 2)))
    d = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    d = d.reshape(-1, 3)
    hits = np.stack(
        [
            np.where(d > 0, (high - o) / d, (low - o) / d)
            for d, o, low, high in ((d[:, 0], x, -3, 3), (d[:, 1], 0, -2, 2), (d[:, 2], 0, -1, 1.6))
        ]
    )
    return d * hits.min(axis=0)[:, None]


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_ifc(tmp_path_factory.mktemp("bim") / "small.ifc").path


def test_without_a_bim_it_runs_through(scans: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    names = ("deviations.bcf", "deviations_3.0.bcf", "elements.json", "elements.csv")
    stale = [tmp_path / "out" / name for name in names]
    for path in stale:
        path.write_text("of an earlier run in this folder, with a plan")
    done = run("--scan-dir", scans, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["anchored"] is False and metrics["reason"] == "no plan was given"
    assert metrics["scans"] == 12
    assert not any(path.exists() for path in stale)
    assert "0.1 s apart" in done.stderr  # the stamps are a guess, which the user can read


@pytest.mark.parametrize(("most", "said"), [
    (1.0, "all signals within their limits"),
    (0.2, "outside their limits: keyframes that see no wall, share of all: 50 % (at most 20 %)"),
])  # fmt: skip
def test_signals_of_quality_are_told_in_words(most: float, said: str, scans: Path, tmp_path: Path) -> None:
    limits = ["--set", f"quality.keyframes_without_walls={most}", "--set", "quality.walls_per_keyframe=0"]
    done = run("--scan-dir", scans, "--out", tmp_path / "out", *limits)
    words = " ".join(done.stdout.replace("│", " ").split())
    assert f"quality of the map {said} 95 % of the positions have a standard deviation of" in words


def test_strict_is_not_content_with_less_than_all(scans: Path, tmp_path: Path) -> None:
    done = run("--scan-dir", scans, "--out", tmp_path / "out", "--strict")
    assert done.returncode == 3, done.stderr
    assert "map only" in done.stdout and "--strict: exit code 3: map only; outside their limits: " in done.stderr
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["anchored_share"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("planned", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_run_takes_no_torch(scans: Path, building: Path, tmp_path: Path, planned: bool) -> None:
    code = "import sys; from sgslam.run import main; assert main(sys.argv[1:]) == 0 and 'torch' not in sys.modules"
    given = ["--scan-dir", scans, "--out", tmp_path / "out", *(["--bim", building] if planned else [])]
    done = subprocess.run([sys.executable, "-c", code, *map(str, given)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_one_bad_scan_is_skipped_and_counted(scans: Path, tmp_path: Path) -> None:
    folder = copied(scans, tmp_path)
    np.save(folder / "5.npy", np.full((100, 3), np.nan))
    done = run("--scan-dir", folder, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert (metrics["scans"], metrics["scans_skipped"]) == (11, 1)


@pytest.mark.slow
def test_more_than_a_fifth_unreadable_is_refused_but_what_was_computed_is_there(scans: Path, tmp_path: Path) -> None:
    folder = copied(scans, tmp_path)
    for i in (8, 9, 10, 11):
        (folder / f"{i}.npy").write_bytes(b"not numpy")
    assert_refused(process("--scan-dir", folder, "--out", tmp_path / "out"), "fifth", str(tmp_path / "out"))
    assert len(Trajectory.read_tum(tmp_path / "out" / "trajectory.tum")) == 8


def copied(scans: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "copy"
    folder.mkdir()
    for file in scans.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.mark.slow
def test_mistakes_with_the_scans(scans: Path, tmp_path: Path) -> None:
    assert_refused(process(), "--scan-dir")
    assert_refused(run("--scan-dir", tmp_path / "nowhere"), "nowhere")
    (tmp_path / "empty").mkdir()
    assert_refused(run("--scan-dir", tmp_path / "empty"), "empty")
    folder = copied(scans, tmp_path)
    (folder / "times.txt").write_text("0.0\n0.1\n")
    assert_refused(run("--scan-dir", folder), "times.txt", "12", "2")
    (folder / "times.txt").write_text("\n".join(str(0.1 * (12 - i)) for i in range(12)))
    assert_refused(run("--scan-dir", folder), "copy", "backwards")
    nan = tmp_path / "nan"
    nan.mkdir()
    for i in range(3):
        np.save(nan / f"{i}.npy", np.full((50, 3), np.nan))
    assert_refused(run("--scan-dir", nan, "--out", tmp_path / "out"), "NaN")


def test_mistakes_with_the_building(scans: Path, building: Path, tmp_path: Path) -> None:
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path / "none.ifc"), "none.ifc")
    (tmp_path / "bad.ifc").write_text("this is not IFC")
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path / "bad.ifc"), "bad.ifc", "IFC")
    (tmp_path / "bare.ifc").write_text(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
        "FILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n#1=IFCCARTESIANPOINT((0.,0.,0.));\nENDSEC;\nEND-ISO-10303-21;\n"
    )
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path / "bare.ifc"), "bare.ifc", "walls")
    assert_refused(run("--scan-dir", scans, "--bim", building, "--storey", "attic"), "attic", "there are")
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path), "folder", "IFC")
    (tmp_path / "cut.ifc").write_bytes(building.read_bytes()[:-500])
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path / "cut.ifc"), "cut.ifc", "cut off")


@pytest.mark.slow
def test_a_demo_with_a_wrong_storey_is_refused_before_the_drive(tmp_path: Path) -> None:
    assert_refused(run("--demo", "--storey", "attic", "--out", tmp_path / "out"), "attic", "there are")
    assert not (tmp_path / "out" / "demo_drive").exists()


def test_mistakes_with_settings_and_the_rest(scans: Path, tmp_path: Path) -> None:
    wrong = "odometry.voxl_size"
    assert_refused(run("--scan-dir", scans, "--set", f"{wrong}=1"), wrong, "odometry.voxel_size")
    assert_refused(run("--scan-dir", scans, "--set", "odometri.voxel_size=1"), "odometri", "'odometry'")
    assert_refused(run("--scan-dir", scans, "--set", "odometry.voxel_size=-1"), "odometry.voxel_size")
    assert_refused(run("--scan-dir", scans, "--set", "odometry"), "a.b=c")
    (tmp_path / "config.yaml").write_text("keyframes: {distanse: 1.0}")
    assert_refused(run("--scan-dir", scans, "--config", tmp_path / "config.yaml"), "distanse", "keyframes.distance")
    assert_refused(run("--scan-dir", scans, "--start", "1,2"), "X,Y,YAW")
    assert_refused(run("--scan-dir", scans, "--start", "1,2,0"), "--bim")
    (tmp_path / "file").write_text("")
    assert_refused(run("--scan-dir", scans, "--out", tmp_path / "file" / "out"), "--out")
    assert_refused(run("--scan-dir", scans, "--ground-truth", tmp_path / "truth.tum"), "truth.tum")
    (tmp_path / "late.tum").write_text("1000.0 0 0 0 0 0 0 1\n1000.1 0 0 0 0 0 0 1\n")
    assert_refused(run("--scan-dir", scans, "--ground-truth", tmp_path / "late.tum"), "late.tum")
    assert_refused(run("--scan-dir", scans, "--frobnicate"), "--frobnicate")
    assert_refused(run("--scan-dir", scans, "--demo"), "--demo")


@pytest.mark.slow
def test_a_mistake_leaves_earlier_results_alone(scans: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run("--scan-dir", scans, "--out", out).returncode == 0
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    assert_refused(run("--scan-dir", scans, "--bim", tmp_path / "none.ifc", "--out", out), "none.ifc")
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before


@pytest.mark.slow
def test_config_of_a_run_repeats_it(scans: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert run("--scan-dir", scans, "--out", first, "--set", "odometry.voxel_size=0.6").returncode == 0
    assert run("--scan-dir", scans, "--out", second, "--config", first / "config.yaml").returncode == 0
    for name in ("config.yaml", "trajectory.tum", "s_graph.json"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
