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
    columns = replace(bare, wall_surfaces=bare.wall_surfaces[:1])
    rooms_alone = replace(cellar, wall_surfaces=())
    one = a_graph(ROOMS[:1], "cellar", "c")
    nowhere = (Door("x0", (), (1.0, 1.0)), Door("x1", ("groom0",), (0.0, 1.0)), Door("x2", ("gone",), (2.0, 2.0)))
    between = (Door("x3", ("gone", "groom2"), (3.0, 4.0)), Door("x4", ("groom0", "croom0"), (900.0, 1.0)))
    no_floors = replace(ground, floors=(), wall_surfaces=tuple(replace(w, floor=None) for w in ground.wall_surfaces))
    return {
        "walls without rooms": _storeys(bare, ground),
        "a single wall": _storeys(columns, ground),
        "rooms without walls": _storeys(rooms_alone, ground),
        "rooms beside walls that are in none": _storeys(replace(bare, rooms=cellar.rooms), ground),
        "a storey with nothing": replace(ground, floors=FLOORS),
        "a storey with one room": _storeys(one, ground),
        "one room in all": one,
        "no rooms at all": bare,
        "doors to nowhere": replace(_storeys(cellar, ground), doors=(*ground.doors, *nowhere, *between)),
        "doors without rooms or storeys": replace(bare, doors=nowhere),
        "walls without a storey": no_floors,
    }
