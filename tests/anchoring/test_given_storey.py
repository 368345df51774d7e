"""A given storey decides between storeys that look alike; it is contradicted where another one fits better."""

from dataclasses import replace

import numpy as np
import pytest
from drives import Drive, fed, small_drive

from data import SceneGraph, WallSurface
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
HIGHER = 3.0  # m


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


def with_upper(graph: SceneGraph, moved: float) -> SceneGraph:
    """With another storey of the same rooms, of which every third wall stands elsewhere by so many metres."""
    (ground,) = graph.floors
    assert ground.elevation is not None
    upper = replace(ground, id="upper", name="Upper", elevation=ground.elevation + HIGHER)

    def there(number: int, wall: WallSurface) -> WallSurface:
        off = moved * (number % 3 == 0) * np.array(wall.normal)
        x, y = (np.array(wall.centroid) + off).tolist()
        height = wall.height and (wall.height[0] + HIGHER, wall.height[1] + HIGHER)
        room = wall.room and wall.room + "'"
        return replace(wall, id=wall.id + "'", room=room, floor="upper", centroid=(x, y), height=height, plane=None)

    rooms = tuple(replace(r, id=r.id + "'", floor="upper") for r in graph.rooms)
    walls = tuple(there(number, wall) for number, wall in enumerate(graph.wall_surfaces))
    floors, doors = (*graph.floors, upper), ()
    return replace(
        graph, floors=floors, rooms=graph.rooms + rooms, wall_surfaces=graph.wall_surfaces + walls, doors=doors
    )


def run(drive: Drive, moved: float, storey: str) -> Result:
    return fed(SceneGraphSlam(with_upper(drive.bim.graph, moved), storey=storey), drive.scans).finish()


def test_a_given_storey_is_contradicted_where_another_explains_the_map_better(drive: Drive) -> None:
    wrong, right = run(drive, 0.6, "Upper"), run(drive, 0.6, "Ground")
    assert right.anchored and drive.rmse(right) < 0.05
    assert not wrong.anchored
    assert "storey 'Ground' of the plan explains the map better" in wrong.reason and "--storey" in wrong.reason


@pytest.mark.long
def test_a_given_storey_decides_between_two_that_look_alike(drive: Drive) -> None:
    for storey, height in (("Ground", 0.0), ("Upper", HIGHER)):
        result = run(drive, 0.0, storey)
        assert result.anchored
        truth = drive.truth.positions[: len(result.trajectory), 2]
        assert np.abs(result.trajectory.positions[:, 2] - truth - height).max() < 0.2
