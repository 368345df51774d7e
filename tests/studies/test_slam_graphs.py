"""S-graphs recorded on a drive: written, read again, and true."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from drives import SENSOR
from small_ifc import STOREY, write_small_ifc

from data import UserError
from data.geometry import se2
from data.simulation.simulate import simulate
from evaluation.drives import SequenceSpec, prepare
from evaluation.drives.slam_graph_files import SlamDrive, drive_file, read_drives, write_drive
from evaluation.drives.slam_graphs import make, record, specs_of
from evaluation.metrics.surface_overlap import best_rigid_fit

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "small.ifc")
    simulate(building.path, STOREY, folder / "drive", seed=1, min_rooms=1, min_length=6.0, sensor=SENSOR)
    scans, truth = folder / "drive" / "scans", folder / "drive" / "truth.tum"
    return SequenceSpec(name="own", bim=str(building.path), scans=str(scans), truth=str(truth))


@pytest.fixture(scope="module")
def drive(spec: SequenceSpec, tmp_path_factory: pytest.TempPathFactory) -> SlamDrive:
    return record(prepare(spec, 0, tmp_path_factory.mktemp("drives")))


@pytest.mark.long
def test_recorded_graphs_lie_where_the_truth_says(drive: SlamDrive) -> None:
    assert [g.whole for g in drive.graphs].count(True) == 1 and drive.graphs[-1].whole
    assert all(a.seconds <= b.seconds for a, b in zip(drive.graphs, drive.graphs[1:], strict=False))
    drawn = drive.graphs[-1].drawn
    storey = drive.a_graph.on_floor(drawn.floor)
    assert storey.rooms and set(drawn.wall_surfaces.values()) <= set(storey.surface_by_id)
    assert len(drawn.wall_surfaces) > 0.8 * len(drawn.s_graph.wall_surfaces)
    assert set(drawn.rooms) <= set(drawn.s_graph.room_by_id)
    fit, centre = best_rigid_fit(drawn.s_graph, storey, drawn.wall_surfaces), drawn.s_graph.centroid()
    off = se2.apply(fit, centre) - se2.apply(np.array(drawn.T_a_s), centre)
    assert np.hypot(*off) < 0.1 and abs(se2.wrap(fit[:1] - drawn.T_a_s[0])[0]) < np.radians(1)


def test_files_are_read_as_they_were_written(drive: SlamDrive, tmp_path: Path) -> None:
    write_drive(tmp_path, drive, "small")
    assert list(read_drives(tmp_path)) == [drive]
    drive_file(tmp_path, "own", 0).write_text('{"graphs": []}')
    with pytest.raises(UserError, match=r"own-0.*make it again"):
        list(read_drives(tmp_path))
    with pytest.raises(UserError, match=r"evaluation\.drives\.slam_graphs"):
        list(read_drives(tmp_path / "drives"))


def test_a_drive_that_is_there_is_left_as_it_is(spec: SequenceSpec, drive: SlamDrive, tmp_path: Path) -> None:
    write_drive(tmp_path, drive, "small")
    before = drive_file(tmp_path, "own", 0).stat().st_mtime_ns
    assert make([spec], [0, 1], tmp_path) == 1
    assert drive_file(tmp_path, "own", 0).stat().st_mtime_ns == before
    lost = SequenceSpec(name="lost", bim=spec.bim, storey="no such storey")
    assert make([lost], [0], tmp_path) == 0
    assert not drive_file(tmp_path, "lost", 0).exists()


def test_which_storeys_are_driven(spec: SequenceSpec) -> None:
    demo, *others = specs_of(["demo", spec.bim])
    assert demo == SequenceSpec(name="demo", bim="demo")
    assert all(s.bim == spec.bim and s.storey for s in others)


@pytest.mark.long
def test_a_missing_building_is_a_users_mistake(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluation.drives.slam_graphs", "--out", str(tmp_path), "--bims", "nowhere.ifc"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("error: nowhere.ifc") and done.stderr.count("\n") == 1
