"""From how many places the walls of a changed storey are seen, or seen through."""

from pathlib import Path

import numpy as np

from data.ifc.writer import IfcWriter, box
from data.simulation import Changes
from data.trajectory import Trajectory
from evaluation.metrics.true_walls import true_walls

ONE_ABSENT, ALL_FILLED = Changes(absent=0.5), Changes(openings_filled=1.0)
ROOM = box(-4, -1, 0, 4, 6, 3)


def views(ifc: Path, changes: Changes, seed: int, at: tuple[float, float]) -> dict[float, tuple[str, int]]:
    """What became of the walls, by their y, and whether they are seen from one place."""
    T_bim_sensor = np.eye(4)
    T_bim_sensor[:3, 3] = (*at, 1.2)
    truth = Trajectory(np.zeros(1, dtype=np.int64), T_bim_sensor[None])
    walls = true_walls(ifc, "Ground", changes, seed, truth, [0])
    return {round(wall.footprint[0][1]): (wall.kind, wall.views) for wall in walls}


def test_a_wall_behind_an_absent_one_is_seen(tmp_path: Path) -> None:
    writer = IfcWriter.begun("walls", {"Ground": 0.0})
    writer.space("room", "Ground", ROOM)
    for y in (2, 4):
        writer.element("IfcWall", "wall", "Ground", [box(-3, y, 0, 3, y + 0.1, 2.5)])
    writer.save(path := tmp_path / "a.ifc")
    plain = views(path, Changes(), 0, (0.0, 0.0))
    assert plain == {2: ("as planned", 1), 4: ("as planned", 0)}
    found = [views(path, ONE_ABSENT, seed, (0.0, 0.0)) for seed in range(6)]
    assert {2: ("absent", 1), 4: ("as planned", 1)} in found
    assert {2: ("as planned", 1), 4: ("absent", 0)} in found


def test_a_wall_is_seen_where_its_door_was_filled(tmp_path: Path) -> None:
    writer = IfcWriter.begun("door", {"Ground": 0.0})
    writer.space("room", "Ground", ROOM)
    wall = writer.element("IfcWall", "wall", "Ground", [box(-0.6, 2, 0, 0.6, 2.1, 2.5)])
    leaf = writer.element("IfcDoor", "door", "Ground", [box(-0.5, 2.03, 0, 0.5, 2.07, 2.45)])
    writer.cut(wall, "Ground", box(-0.5, 2, 0, 0.5, 2.1, 2.45), filling=leaf)
    writer.element("IfcWall", "behind", "Ground", [box(-3, 4, 0, 3, 4.1, 2.5)])
    writer.save(path := tmp_path / "a.ifc")
    assert views(path, Changes(), 0, (0.0, 0.0))[2] == ("as planned", 0)
    assert views(path, ALL_FILLED, 0, (0.0, 0.0))[2] == ("as planned", 1)
