"""A-graphs with storeys that lack rooms or walls, and with doors that lead nowhere."""

from dataclasses import replace

from plans import a_graph, box, merged

from data import Door, Floor, SceneGraph

ROOMS = [box(0, 0, 5, 3), box(5.2, 0, 3, 4.4), box(0, 4.6, 8.2, 2.2)]
FLOORS = (Floor("cellar", "Cellar", -3.0), Floor("ground", "Ground", 0.0))


def _storeys(cellar: SceneGraph, ground: SceneGraph) -> SceneGraph:
    return replace(merged(cellar, ground), floors=FLOORS)


def odd_plans() -> dict[str, SceneGraph]:
    """Each by what is odd about it; all have rooms with walls above, but for those in which no storey has any."""
    cellar, ground = a_graph(ROOMS, "cellar", "c"), a_graph(ROOMS, "ground", "g")
    ground = replace(ground, doors=(Door("d0", ("groom0", "groom1"), (5.1, 1.0)),))
    bare = replace(cellar, rooms=(), wall_surfaces=tuple(replace(w, room=None) for w in cellar.wall_surfaces))
    rooms_alone = replace(cellar, wall_surfaces=())
    one = a_graph(ROOMS[:1], "cellar", "c")
    nowhere = (Door("x0", (), (1.0, 1.0)), Door("x1", ("groom0",), (0.0, 1.0)), Door("x2", ("gone",), (2.0, 2.0)))
    no_floors = replace(ground, floors=(), wall_surfaces=tuple(replace(w, floor=None) for w in ground.wall_surfaces))
    return {
        "walls without rooms": _storeys(bare, ground),
        "rooms without walls": _storeys(rooms_alone, ground),
        "a storey with nothing": replace(ground, floors=FLOORS),
        "one room in all": one,
        "doors without rooms or storeys": replace(bare, doors=nowhere),
        "walls without a storey": no_floors,
    }
