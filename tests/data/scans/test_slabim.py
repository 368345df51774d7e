"""Real scans with a plan in the form of SLABIM: a drive of our own in that form, laid out by a command and run."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import called, refused
from slabim_form import SESSION, SITE, write_slabim

from data.common.errors import UserError
from data.datasets import SlabimSession
from data.plans import load_bim
from data.scans import ScanFolder
from data.trajectory import Trajectory


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The floor and the walls of three rooms in files of their own, scans, stamps and poses."""
    return write_slabim(tmp_path_factory.mktemp("slabim"))


@pytest.mark.long
def test_a_session_is_laid_out_and_anchored(dataset: Path, tmp_path: Path) -> None:
    sequence, out = tmp_path / "sequence", tmp_path / "out"
    done = called("data.datasets.__main__", dataset, SESSION, "--out", sequence)
    assert done.returncode == 0, done.stderr
    scans, truth = ScanFolder(sequence / "scans"), Trajectory.read_tum(sequence / "truth.tum")
    assert len(scans) == len(truth) > 15 and [f.stem for f in scans.files[:3]] == ["0", "1", "2"]
    assert np.array_equal(scans.stamps_ns, truth.stamps_ns)
    graph = load_bim(sequence / "a_graph.json").graph
    assert len(graph.rooms) == 3 and np.allclose(graph.rooms[0].centroid, SITE[:2] + np.array([3.0, 2.0]), atol=0.05)
    done = called("sgslam.run", "--scan-dir", sequence / "scans", "--bim", sequence / "a_graph.json", "--out", out,
                  "--ground-truth", sequence / "truth.tum", "--set", "matching.method=voting")  # fmt: skip
    assert done.returncode == 0, done.stderr
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["scans"] == len(scans) and metrics["anchored"]
    assert metrics["accuracy"]["rmse_bim_m"] < 0.05


def test_inconsistent_files_are_refused(dataset: Path, tmp_path: Path) -> None:
    shutil.copytree(dataset, copy := tmp_path / "copy")
    points = copy / "sensor_data" / SESSION / "points"
    poses = (points / "pose_frame_to_bim.txt").read_text().splitlines()
    same = "\n".join(" ".join((line.split()[0], *poses[0].split()[1:])) for line in poses)
    stamps = "\n".join((points / "timestamps.txt").read_text().splitlines()[1:])
    for folder, session, edit, message in (
        (dataset, "5F_Region1", None, f"there are: {SESSION}"),
        (tmp_path, SESSION, None, "BIM and sensor_data"),
        (copy, SESSION, ("pose_frame_to_bim.txt", same), "all poses are the same"),
        (copy, SESSION, ("timestamps.txt", stamps), f"{len(poses) - 1} stamps for {len(poses)} scans"),
    ):
        if edit is not None:
            (points / edit[0]).write_text(edit[1])
        with pytest.raises(UserError, match=message):
            SlabimSession.open(folder, session)
    (copy / "BIM/3F/mesh/walls.ply").unlink()
    assert "no walls.ply" in refused("data.datasets.__main__", copy, SESSION, "--out", tmp_path / "out")
