"""evalio's data sets as scans, and sgslam as one of its pipelines, by evalio's own commands."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commands import refused
from drives import CARRIER, SENSOR
from small_ifc import write_small_ifc

from data.simulation.simulate import simulate

pytest.importorskip("evalio", reason="evalio is not installed: pip install 'sgslam[evalio]'")
HELPERS = Path(__file__).resolve().parents[2] / "helpers"
ROOT = HELPERS.parents[1]
NAME, COUNT = "simulated_drive/small", 100
CUSTOM = "evalio_drive,sgslam.evalio_pipeline"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a building and a drive through it, where evalio looks for data."""
    folder = tmp_path_factory.mktemp("evalio")
    building = write_small_ifc(folder / "small.ifc")
    way = {"seed": 3, "min_rooms": 3, "min_length": 20.0, "sensor": SENSOR, "carrier": CARRIER}
    simulate(building.path, "Ground", folder / NAME, **way, imu="tactical", effects=("rolling",))
    return folder


@pytest.fixture
def known(home: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """evalio, in this process, knows the data set and where its data lie."""
    import evalio_drive
    from evalio import datasets

    datasets.register_dataset(module=evalio_drive)
    monkeypatch.setattr("evalio.datasets.base._DATA_DIR", home)
    return home


def evalio(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """What the command `evalio` says."""
    paths = os.pathsep.join(map(str, (ROOT, HELPERS)))
    environment = os.environ | {"PYTHONPATH": paths, "EVALIO_DATA": str(folder), "EVALIO_CUSTOM": CUSTOM}
    line = [sys.executable, "-c", "from evalio.cli import app; app()", *words]
    return subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def error_of(folder: Path, name: str) -> tuple[Any, float]:
    """The trajectory that a pipeline left, and its RMS error (m) by evalio's own measure."""
    from evalio import stats
    from evalio.types import Trajectory

    found = Trajectory.from_file(folder / NAME / f"{name}.csv")
    truth = Trajectory.from_file(folder / NAME / "gt.csv")
    assert isinstance(found, Trajectory) and isinstance(truth, Trajectory), (found, truth)
    return found, stats.ate(found, truth).sse().trans


@pytest.mark.slow
def test_evalio_runs_our_tracking_beside_its_own(home: Path) -> None:
    planned = {"pipeline": "sgslam", "name": "planned", "plan": str(home / "small.ifc"), "use_imu": False}
    config = {"datasets": [{"name": NAME, "length": COUNT}], "pipelines": ["kiss", "sgslam", planned]}
    (home / "config.yaml").write_text(json.dumps(config))
    done = evalio(home, "run", "-c", "config.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    errors = {}
    for name in ("kiss", "sgslam", "planned"):
        found, errors[name] = error_of(home / "evalio_results/config", name)
        assert (found.metadata.status.value, len(found)) == ("complete", COUNT), done.stdout + done.stderr
    assert errors["sgslam"] < errors["kiss"] and errors["planned"] < errors["kiss"]
    assert max(errors["sgslam"], errors["planned"]) < 0.05


def test_what_is_missing_is_told_in_one_line(known: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("sgslam.run", "--out", tmp_path / "out", "--scan-dir")
    assert f"did you mean '{NAME}'" in refused(*words, "evalio:simulated_drive/smal")
    assert "evalio dl simulated_drive/long" in refused(*words, "evalio:simulated_drive/long")
    assert "no topics" in refused(*words, f"evalio:{NAME}", "--topic", "/points")
    for part in ("scans", "truth.tum", "scans/imu.csv"):
        (tmp_path / "simulated_drive/long" / part).mkdir(parents=True)
    monkeypatch.setattr("evalio.datasets.base._DATA_DIR", tmp_path)
    assert "simulated_drive/long/" in refused(*words, "evalio:simulated_drive/long")  # the data set says what it lacks
    monkeypatch.setitem(sys.modules, "evalio", None)
    assert "pip install 'sgslam[evalio]'" in refused(*words, f"evalio:{NAME}")
