"""One house, written as programs write it: read as it is, or what is amiss told in a line."""

from pathlib import Path

import pytest
from odd_ifc import ODD, SWISS

from data import UserError
from data.ifc.graph import read_ifc

NOT_READ = {"proxies": "has no walls", "axes alone": r"no walls with a geometry \(5 without\)"}
TOLD = {
    "storeys without rooms": ["no rooms on first"],
    "spaces thrice": ["4 of 6 spaces left out: 4 double"],
    "spaces without bodies": ["2 rooms were made", "2 without solid geometry (A, B)"],
    "flat spaces": ["2 rooms were made", "2 without solid geometry (A, B)"],
    "no spaces": ["2 rooms were made"],
    "no storeys": ["no IfcBuildingStorey: 2 made"],
    "no storeys, no spaces": ["3 rooms were made", "no IfcBuildingStorey: 2 made"],
    "wrong unit": ["seem to be in millimetres"],
    "ids twice": ["GlobalIds given more than once: 3"],
}
AROUND = {"curved": [18.0, 21.03]}  # m of walls around A and B
OUTSIDE = {  # m of walls that face no room
    "curtain": 28.2,
    "curved": 32.0,
    "storeys without rooms": 2 * 28.8 + 26.4,
    "two buildings": 2 * 28.8,
    "no storeys": 2 * 28.8,
    "no storeys, no spaces": 2 * 28.8,
}


@pytest.mark.parametrize("kind", ODD)
def test_odd_models_are_read_or_told(kind: str, tmp_path: Path) -> None:
    ifc = ODD[kind]().save(tmp_path / "odd.ifc")
    if kind in NOT_READ:
        with pytest.raises(UserError, match=NOT_READ[kind]):
            read_ifc(ifc)
        return
    graph, notices = read_ifc(ifc)
    assert len(notices) == len(TOLD.get(kind, []))
    assert all(words in notice for words, notice in zip(TOLD.get(kind, []), notices, strict=True))
    if kind in ("wrong unit", "ids twice"):
        return
    assert sorted(len(door.rooms) for door in graph.doors) == [1, 2]
    around = sorted(sum(w.length or 0.0 for w in graph.surfaces_of_room[r.id]) for r in graph.rooms)
    assert around[:2] == pytest.approx(AROUND.get(kind, [18.0, 18.0]), abs=0.1)
    outside = sum(w.length or 0.0 for w in graph.wall_surfaces if w.room is None)
    assert outside == pytest.approx(OUTSIDE.get(kind, 28.8), abs=0.1)
    elevations = {f.id: f.elevation for f in graph.floors}
    assert min(z for z in elevations.values() if z is not None) == pytest.approx(
        SWISS[2] if kind == "drawn in the country's grid" else 0.0
    )
    assert {w.floor for w in graph.wall_surfaces} <= set(elevations)
