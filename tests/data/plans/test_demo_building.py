"""The demo's building, as others see it: the A-graph, the simulator, the matcher."""

import os
import subprocess
import sys
from itertools import pairwise
from math import dist
from pathlib import Path

import numpy as np
import pytest
import shapely

from data.common.errors import UserError
from data.generation.demo_building import DEMO_STOREY, write_demo_building
from data.ifc.products import open_ifc
from data.plans import Bim, load_bim
from data.scene_graph import SceneGraph

STOREYS = ("Ground floor", "Upper floor")


@pytest.fixture(scope="module")
def ifc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("demo") / "demo.ifc"
    write_demo_building(path)
    return path


@pytest.fixture(scope="module")
def bim(ifc: Path) -> Bim:
    return load_bim(ifc, ifc.parent)


def floor_of(graph: SceneGraph, name: str) -> SceneGraph:
    return graph.on_floor(next(f.id for f in graph.floors if f.name == name))


def test_rooms_are_enclosed_by_their_surfaces_and_two_are_equal(ifc: Path, bim: Bim) -> None:
    """Moved along x, mirrored as to their doors on the upper floor."""
    assert open_ifc(ifc).schema == "IFC4" and bim.notices == () and DEMO_STOREY in STOREYS
    assert [f.name for f in bim.graph.floors] == [*STOREYS]
    assert [f.elevation for f in bim.graph.floors] == pytest.approx([0.0, 3.2])
    for name, twins, sign in (
        ("Ground floor", ("Office 1", "Office 2"), 1),
        ("Upper floor", ("Office 3", "Office 4"), -1),
    ):
        floor = floor_of(bim.graph, name)
        assert len(floor.rooms) >= 10
        for r in floor.rooms:
            assert r.polygon is not None and len(floor.surfaces_of_room[r.id]) == len(r.polygon)
            around = sum(dist(a, b) for a, b in pairwise([*r.polygon, r.polygon[0]]))
            assert sum(w.length or 0.0 for w in floor.surfaces_of_room[r.id]) == pytest.approx(around, abs=0.01)
        assert any(len(r.polygon or ()) == 6 for r in floor.rooms), "an L-shaped room"
        one, two = (next(r for r in floor.rooms if r.name.endswith(f" {twin}")) for twin in twins)
        step = np.subtract(two.centroid, one.centroid)
        moved = shapely.affinity.translate(shapely.Polygon(one.polygon), *step)
        assert moved.symmetric_difference(shapely.Polygon(two.polygon)).area < 1e-6
        doors = [next(d for d in floor.doors if r.id in d.rooms).centroid[0] - r.centroid[0] for r in (one, two)]
        assert step[1] == pytest.approx(0.0, abs=1e-6) and doors[1] == pytest.approx(sign * doors[0], abs=1e-3)


@pytest.mark.slow
def test_the_command_writes_the_same_bytes_whatever_the_path(ifc: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "data.generation.demo_building", "--out", "other.ifc"]
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert DEMO_STOREY in done.stdout and (tmp_path / "other.ifc").read_bytes() == ifc.read_bytes()
    for name in ("building.json", "no/such/folder.ifc"):
        with pytest.raises(UserError, match=name):
            write_demo_building(tmp_path / name)
