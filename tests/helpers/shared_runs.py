"""Runs that several test files look at; all workers share them."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import ifcopenshell
import numpy as np
import pytest
from commands import called
from drives import small_drive
from small_ifc import write_small_ifc

MOVED, BY = "between", 0.06  # m, a wall of the plan along the building's x axis, which was built elsewhere


def written_once(factory: pytest.TempPathFactory, name: str, write: Callable[[Path], None]) -> Path:
    """A folder that the first worker writes who asks for it."""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    with folder.with_suffix(".lock").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until it is closed
        if not folder.exists():
            folder.mkdir()
            write(folder)
    return folder


def write_scans(folder: Path, count: int | None = None) -> Path:
    """The small drive as files, the first `count` scans of it, with stamps."""
    folder.mkdir()
    scans = small_drive().scans[:count]
    for k, (_, points) in enumerate(scans):
        np.save(folder / f"{k:06d}.npy", points)
    (folder / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp, _ in scans))
    return folder


def write_anchored_run(folder: Path) -> None:
    """`small.ifc`, kilometres from zero, of which one wall was built elsewhere; `scans`, `truth.tum`, and in `out` what
    the command left of them."""
    ifc = write_small_ifc(folder / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0).path
    model = ifcopenshell.open(str(ifc))
    (wall,) = (own for own in model.by_type("IfcWall") if own.Name == MOVED)
    place = wall.ObjectPlacement.RelativePlacement.Location
    place.Coordinates = (place.Coordinates[0] + BY, *place.Coordinates[1:])
    model.write(str(ifc))
    small_drive().truth.write_tum(folder / "truth.tum")
    given = ("--scan-dir", write_scans(folder / "scans"), "--ground-truth", folder / "truth.tum", "--bim", ifc)
    done = called("sgslam.run", *given, "--out", folder / "out")
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def anchored_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `write_anchored_run`; not to be changed."""
    return written_once(tmp_path_factory, "anchored_run", write_anchored_run)
