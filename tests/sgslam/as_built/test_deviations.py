"""Deviations of walls: moved, missing, extra, furniture; several walls in one plane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sgslam.as_built.deviation_tests import run_deviation_tests
from sgslam.as_built.mapped_walls import MappedWalls
from sgslam.as_built.visibility import Visibility
from sgslam.as_built.wall_solids import WallSolid, sides_of, solids_of
from small_ifc import STOREY, write_small_ifc

from data import WallSurface
from data.ifc.writer import IfcWriter, box
from data.plans import load_bim
from data.simulation import Changes
from data.simulation.changes.as_built import write_plan_without
from data.simulation.simulate import simulate
from sgslam.anchoring import AlignedWall
from sgslam.anchoring.wall_association import WallArrays, associate_walls
from sgslam.as_built import Piece
from sgslam.config import AnchorSettings, AsBuiltSettings, Config


def side(name: str, y: float, ny: float, source: str = "wall", x: float = 0.0, length: float = 6.0) -> WallSurface:
    return WallSurface(name, None, (x, y), (0.0, ny), length, None, source)


# a wall of 12 cm: its southern side a, its northern side b
A, B = side("a", 0.0, -1.0), side("b", 0.12, 1.0)


def piece(planned: WallSurface, offset: float, low: float, high: float, **more: float | bool | str) -> Piece:
    seen = replace(planned, id=f"s{planned.id}{low}", length=high - low)
    known = {"source": planned.source, "sigma": 0.005, "tilt": 0.0, "over_parapet": False} | more
    aligned = AlignedWall(seen, planned, offset, abs(offset) < 0.02)
    return Piece(aligned, offset=offset, span=(low, high), length=high - low, **known)  # type: ignore[arg-type]


def solids(*surfaces: WallSurface) -> list[WallSolid]:
    return solids_of([own for surface in surfaces for own in sides_of(surface)])


def seen_through(low: float, high: float) -> dict[tuple[str, str], Visibility]:
    """The wall is seen through between two places from its side a."""
    along = np.arange(-2.9, 3.0, 0.1)
    through = (along > low) & (along < high)
    return {("a", "wall"): Visibility(along, through, ~through)}


PLANE = replace(A, parts=(("right", -3.0, 0.0, True), ("left", 0.0, 3.0, True)))  # of two walls end to end


@pytest.mark.parametrize(
    ("pieces", "opening", "significant", "reasons"),
    [
        ([piece(A, 0.2, -3, 0), piece(B, -0.2, -1, 2), piece(B, 0.35, 2, 3)], (0, 0), [True, True, False],
         {0: "both sides", 2: "another offset"}),
        ([piece(A, 0.3, -3, 1), piece(B, 0.001, -3, 3)], (0, 0), [False, False], {0: "furniture", 1: "as planned"}),
        ([piece(A, -0.13, -3, -1)], (0, 0), [True], {}),
        ([piece(A, -0.13, -3, -1)], (0, 1), [False], {0: "seen through"}),  # the back of a cupboard
        # within the wall's own thickness no cupboard can stand: the wall was moved, and has an opening
        ([piece(A, -0.06, -3, -1)], (0, 1), [True], {}),
        ([piece(A, -0.2, 0, 2, over_parapet=True), piece(A, 0.0, -3, 0)], (0, 0), [False, False], {0: "pane"}),
        # the left one was built 15 cm back
        ([piece(PLANE, -0.15, 0.3, 3.0, source="left"), piece(PLANE, 0.0, -3.0, 0.0, source="right")], (0, 0),
         [True, False], {}),
    ],
)  # fmt: skip
def test_a_wall_is_moved_where_no_furniture_and_no_opening_explains_it(
    pieces: list[Piece], opening: tuple[float, float], significant: list[bool], reasons: dict[int, str]
) -> None:
    surfaces = (PLANE,) if pieces[0].aligned.planned is PLANE else (A, B)
    found = run_deviation_tests(pieces, solids(*surfaces), seen_through(*opening), Config())
    assert [v.significant for v in found] == significant
    assert all(reason in found[k].reason for k, reason in reasons.items())


@pytest.mark.parametrize(("tolerance", "moved"), [(0.01, True), (0.03, False)])
def test_the_tolerance_of_the_findings_is_the_users(tolerance: float, moved: bool) -> None:
    """A wall that stands off by 22 mm, with a sigma of 5 mm; what the map is anchored with has no say."""
    config = Config(as_built=AsBuiltSettings(tolerance=tolerance), anchors=AnchorSettings(tolerance=0.1))
    pieces = [piece(A, 0.022, -3, 3), piece(B, -0.022, -3, 3)]
    found = run_deviation_tests(pieces, solids(A, B), seen_through(0, 0), config)
    assert [v.significant for v in found] == [moved, moved]


def arrays(*surfaces: WallSurface) -> WallArrays:
    return WallArrays.of(list(surfaces), {}, np.zeros(2))


def test_a_long_wall_is_not_the_stub_that_it_has_come_near_to() -> None:
    stub, long = side("stub", 0.0, 1.0, "stub", length=0.3), side("long", -0.25, 1.0, "long", x=0.5, length=3.0)
    seen, in_place = (arrays(side("seen", y, 1.0, length=2.5)) for y in (0.04, 0.01))
    for walls, planned, expected in ((seen, (stub, long), 1), (seen, (stub,), -1), (in_place, (stub,), 0)):
        assert associate_walls(walls, arrays(*planned), 0.4, 0.07).tolist() == [expected]


Wall = tuple[float, float, float, float, float]  # centre x y, normal x y, length
FACE: Wall = (0.0, 0.0, 0.0, 1.0, 4.0)  # along x, from -2 to 2, seen from y > 0
BEHIND, LEFT, RIGHT = (3.0, -0.4, 0.0, 1.0, 4.0), (-2.1, 1.0, 1.0, 0.0, 3.0), (2.1, 1.0, -1.0, 0.0, 3.0)


def mapped(walls: list[Wall], planned: list[Wall], tops: list[float]) -> MappedWalls:
    seen, known = (
        [WallSurface(f"w{k}", None, (x, y), (nx, ny), length) for k, (x, y, nx, ny, length) in enumerate(own)]
        for own in (walls, planned)
    )
    n, top = len(walls), np.array(tops)
    return MappedWalls(
        seen, arrays(*seen), arrays(*known), list(range(n)), np.zeros(n), top, top, np.full(n, 9), set()
    )  # fmt: skip


@pytest.mark.parametrize(
    ("planned", "free"),
    [
        ([], 4.0),
        ([(-3.0, 0.0, 0.0, 1.0, 4.0), (-3.0, -0.2, 0.0, -1.0, 4.0)], 3.0),  # both faces of one wall that goes on
        ([(0.0, -0.4, 0.0, 1.0, 6.0)], 0.0),  # a wall behind it, which it may be furniture of
        ([(0.0, -1.0, 0.0, 1.0, 6.0)], 4.0),
        ([(0.0, 0.0, 1.0, 0.0, 4.0)], 4.0),  # across it
    ],
)
def test_the_part_without_a_planned_wall_is_unplanned(planned: list[Wall], free: float) -> None:
    stretches = mapped([FACE], planned, [2.5]).unplanned_stretches(0)
    assert sum(high - low for low, high in stretches) == pytest.approx(free)


def test_what_stands_before_a_taller_wall_is_furniture() -> None:
    assert mapped([FACE, BEHIND], [], [1.9, 2.5]).stands_before_another(0)
    assert not mapped([FACE, BEHIND], [], [1.9, 2.5]).stands_before_another(1)
    assert not mapped([FACE, BEHIND], [], [1.9, 1.9]).stands_before_another(0)
    assert not mapped([FACE, (3.0, -0.4, 0.0, -1.0, 4.0)], [], [1.9, 2.5]).stands_before_another(0)


@pytest.mark.parametrize(
    ("walls", "planned", "tops", "closes"),
    [
        ([FACE], [LEFT, RIGHT], [1.5], True),
        ([FACE, LEFT], [RIGHT], [1.5, 2.5], True),
        ([FACE], [LEFT], [1.5], False),
        ([FACE], [LEFT, RIGHT], [1.2], False),  # a screen
        ([FACE, LEFT], [RIGHT], [1.5, 0.9], False),  # ends at a box
    ],
)
def test_a_wall_between_two_walls_closes_a_room(
    walls: list[Wall], planned: list[Wall], tops: list[float], closes: bool
) -> None:
    assert mapped(walls, planned, tops).closes_a_room(0) is closes


def test_a_plan_tells_which_wall_stands_where_in_a_plane(tmp_path: Path) -> None:
    """A room of 8 m by 4 m, whose northern side two walls of the model make, the second with a door."""
    writer = IfcWriter("Two in a row", {"Ground": 0.0})
    for name, x0, y0, x1, y1 in (
        ("west", -0.2, -0.2, 0.0, 4.2), ("east", 8.0, -0.2, 8.2, 4.2), ("south", 0.0, -0.2, 8.0, 0.0),
        ("first", 0.0, 4.0, 3.0, 4.2), ("second", 3.0, 4.0, 8.0, 4.2),
    ):  # fmt: skip
        host = writer.element("IfcWall", name, "Ground", [box(x0, y0, 0.0, x1, y1, 2.6)])
    writer.cut(host, "Ground", box(5.0, 4.0, 0.0, 6.0, 4.2, 2.1))
    writer.space("Room", "Ground", box(0.0, 0.0, 0.0, 8.0, 4.0, 2.6))
    writer.save(tmp_path / "row.ifc")
    names = {w.GlobalId: w.Name for w in writer.model.by_type("IfcWall")}
    graph = load_bim(tmp_path / "row.ifc", tmp_path).graph
    north = next(w for w in graph.wall_surfaces if w.normal[1] < -0.9 and w.length and w.length > 7)
    # leftward as one looks along the normal, which points south: eastward
    x = north.centroid[0]
    parts = {(names[s], round(x + low, 2), round(x + high, 2)) for s, low, high, whole in north.parts if whole}
    assert parts == {("first", 0.0, 3.0), ("second", 3.0, 5.0), ("second", 6.0, 8.0)}
    assert sorted(len(own.spans) for own in sides_of(north)) == [1, 2]
    assert graph == type(graph).from_dict(graph.to_dict())


@pytest.mark.slow
def test_what_no_plan_shows_is_taken_from_the_plan(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc")
    graph = load_bim(building.path, tmp_path).graph

    def lacking(plan: Path) -> set[str]:
        found = load_bim(plan, tmp_path).graph
        assert {r.id for r in found.rooms} == {r.id for r in graph.rooms}
        return {w.source for w in graph.wall_surfaces} - {w.source for w in found.wall_surfaces}

    gone = next(w.source for w in graph.wall_surfaces if w.length and w.length < 4)
    write_plan_without(building.path, [gone], tmp_path / "plan.ifc")
    assert lacking(tmp_path / "plan.ifc") == {gone}
    changes = Changes(unplanned=0.2)
    run = simulate(building.path, STOREY, tmp_path / "run", seed=2, min_rooms=1, min_length=2.0, changes=changes)
    (change,) = run.changes
    assert change.kind == "unplanned" and lacking(tmp_path / "run" / "plan.ifc") == {change.id}
