"""Deviations of walls: moved, missing, extra, furniture; several walls in one plane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import fed, small_drive, small_run
from small_ifc import STOREY, write_small_ifc

from data import WallSurface
from data.common.errors import UserError
from data.ifc.writer import IfcWriter, box
from data.plans import load_bim
from data.simulation import Changes
from data.simulation.changes.as_built import write_plan_without
from data.simulation.simulate import simulate
from sgslam.anchoring import AlignedWall, WallAlignment
from sgslam.anchoring.wall_association import WallArrays, associate_walls
from sgslam.as_built import Piece
from sgslam.as_built.deviation_tests import DeviationTest, run_deviation_tests
from sgslam.as_built.mapped_walls import has_other_side
from sgslam.as_built.missing_walls import missing_walls
from sgslam.as_built.visibility import Visibility
from sgslam.as_built.wall_solids import WallSolid, sides_of, solids_of
from sgslam.config import AnchorSettings, AsBuiltSettings, Config
from sgslam.report import ReportData
from sgslam.report.contents import entered_unmatched
from sgslam.slam import SceneGraphSlam

CONFIG = Config()


def side(name: str, y: float, ny: float, source: str = "wall", x: float = 0.0, length: float = 6.0) -> WallSurface:
    return WallSurface(name, None, (x, y), (0.0, ny), length, None, source)


# a wall of 12 cm: its southern side a, its northern side b
A, B = side("a", 0.0, -1.0), side("b", 0.12, 1.0)


def piece(planned: WallSurface, offset: float, low: float, high: float, **more: float | bool) -> Piece:
    seen = replace(planned, id=f"s{planned.id}{low}", length=high - low)
    aligned = AlignedWall(seen, planned, offset, abs(offset) < 0.02)
    told = {"sigma": 0.005, "tilt": 0.0, "over_parapet": False} | more
    return Piece(aligned, planned.source, offset, span=(low, high), length=high - low, **told)  # type: ignore[arg-type]


def check(
    pieces: list[Piece], surfaces: tuple[WallSurface, ...] = (A, B), open_: tuple[float, float] | None = None,
    config: Config = CONFIG,
) -> list[DeviationTest]:  # fmt: skip
    """The results of the tests; the wall is seen through between `open_` from its side a."""
    along = np.arange(-2.9, 3.0, 0.1)
    through = np.zeros(len(along), bool) if open_ is None else (along > open_[0]) & (along < open_[1])
    visibility = {("a", "wall"): Visibility(along, through, ~through)}
    return run_deviation_tests(pieces, solids(*surfaces), visibility, config)


def solids(*surfaces: WallSurface) -> list[WallSolid]:
    return solids_of([own for surface in surfaces for own in sides_of(surface)])


def test_both_sides_of_a_wall_are_one_solid() -> None:
    stub = side("c", 0.06, 1.0, x=20.0, length=0.4)
    end = WallSurface("d", None, (3.0, 0.06), (1.0, 0.0), 0.12, None, "wall")
    other = side("e", 0.12, 1.0, "another")
    found = solids(A, B, stub, end, other)
    assert [sorted(key[0] for key in solid.facing) for solid in found] == [["a", "b", "c"], ["d"], ["e"]]
    assert found[0].thickness == pytest.approx(0.12)
    assert found[0].facing[("a", "wall")] == -found[0].facing[("b", "wall")]
    assert found[2].thickness is None


def test_a_moved_wall_is_significant_on_both_sides() -> None:
    told = check([piece(A, 0.2, -3, 0), piece(B, -0.2, -1, 2), piece(B, 0.35, 2, 3)])
    assert [v.significant for v in told] == [True, True, False]
    assert "both sides" in told[0].reason and "another offset" in told[2].reason


@pytest.mark.parametrize(("tolerance", "moved"), [(0.01, True), (0.03, False)])
def test_the_tolerance_of_the_findings_is_the_users(tolerance: float, moved: bool) -> None:
    """A wall that stands off by 22 mm, with a sigma of 5 mm; what the map is anchored with has no say."""
    config = Config(as_built=AsBuiltSettings(tolerance=tolerance), anchors=AnchorSettings(tolerance=0.1))
    told = check([piece(A, 0.022, -3, 3), piece(B, -0.022, -3, 3)], config=config)
    assert [v.significant for v in told] == [moved, moved]


def test_a_fine_tolerance_makes_no_wall_missing() -> None:
    """A wall 22 mm off, seen too skew to call it moved, beside a stretch that is seen through."""
    along = np.arange(-2.9, 3.0, 0.1)
    through = along > 0.0
    seen = {("a", "wall"): Visibility(along, through, ~through)}
    config = Config(as_built=AsBuiltSettings(tolerance=0.005))
    own = [piece(A, 0.022, -1.5, -0.6, tilt=0.03)]
    sides, solid = sides_of(A), solids(A)
    found = run_deviation_tests(own, solid, seen, config)
    alignment = WallAlignment([p.aligned for p in own], np.zeros(3), 0.05, 1.0)
    assert not any(result.significant for result in found)
    assert not missing_walls(sides, solid, alignment, own, found, seen, config)


def test_what_stands_before_a_wall_whose_other_side_stands_is_furniture() -> None:
    told = check([piece(A, 0.3, -3, 1), piece(B, 0.001, -3, 3)])
    assert not any(v.significant for v in told)
    assert "furniture" in told[0].reason and told[1].reason == "as planned"


def test_the_back_of_a_cupboard_at_a_wall_that_is_seen_through_is_no_moved_wall() -> None:
    back = [piece(A, -0.13, -3, -1)]
    assert [v.significant for v in check(back)] == [True]
    seen_through = check(back, open_=(0.0, 1.0))
    assert not seen_through[0].significant and "seen through" in seen_through[0].reason
    # within the wall's own thickness no cupboard can stand: the wall was moved, and has an opening
    assert check([piece(A, -0.06, -3, -1)], open_=(0.0, 1.0))[0].significant


def test_a_pane_over_its_parapet_is_listed_with_its_reason() -> None:
    told = check([piece(A, -0.2, 0, 2, over_parapet=True), piece(A, 0.0, -3, 0)])
    assert not any(v.significant for v in told)
    assert "pane" in told[0].reason


def test_walls_in_one_plane_are_tested_separately() -> None:
    """One surface, of two walls end to end; the left one was built 15 cm back."""
    plane = replace(A, parts=(("right", -3.0, 0.0, True), ("left", 0.0, 3.0, True)))
    moved, stands = (replace(piece(plane, o, *span), source=s) for s, o, span in
                     (("left", -0.15, (0.3, 3.0)), ("right", 0.0, (-3.0, 0.0))))  # fmt: skip
    told = run_deviation_tests([moved, stands], solids(plane), {}, CONFIG)
    assert [v.significant for v in told] == [True, False]


def test_a_plan_tells_which_wall_stands_where_in_a_plane(tmp_path: Path) -> None:
    """A room of 8 m by 4 m, whose northern side two walls of the model make, the second with a door."""
    writer = IfcWriter("Two in a row", {"Ground": 0.0})
    for name, solid in {
        "west": (-0.2, -0.2, 0.0, 4.2), "east": (8.0, -0.2, 8.2, 4.2), "south": (0.0, -0.2, 8.0, 0.0),
        "first": (0.0, 4.0, 3.0, 4.2), "second": (3.0, 4.0, 8.0, 4.2),
    }.items():  # fmt: skip
        x0, y0, x1, y1 = solid
        host = writer.element("IfcWall", name, "Ground", [box(x0, y0, 0.0, x1, y1, 2.6)])
        if name == "second":
            writer.cut(host, "Ground", box(5.0, 4.0, 0.0, 6.0, 4.2, 2.1))
    writer.space("Room", "Ground", box(0.0, 0.0, 0.0, 8.0, 4.0, 2.6))
    writer.save(tmp_path / "row.ifc")
    names = {w.GlobalId: w.Name for w in writer.model.by_type("IfcWall")}
    graph = load_bim(tmp_path / "row.ifc", tmp_path).graph
    north = next(w for w in graph.wall_surfaces if w.normal[1] < -0.9 and w.length and w.length > 7)
    # leftward as one looks along the normal, which points south: eastward
    told = {(names[s], round(north.centroid[0] + low, 2), round(north.centroid[0] + high, 2)) for s, low, high, whole
            in north.parts if whole}  # fmt: skip
    assert told == {("first", 0.0, 3.0), ("second", 3.0, 5.0), ("second", 6.0, 8.0)}
    first, second = sorted(sides_of(north), key=lambda own: own.hull)
    assert len(first.spans) == 1 and len(second.spans) == 2
    assert graph == type(graph).from_dict(graph.to_dict())


def test_a_long_wall_is_not_the_stub_that_it_has_come_near_to() -> None:
    stub, long = side("stub", 0.0, 1.0, "stub", length=0.3), side("long", -0.25, 1.0, "long", x=0.5, length=3.0)
    planned = WallArrays.of([stub, long], {}, np.zeros(2))
    seen = WallArrays.of([side("seen", 0.04, 1.0, length=2.5)], {}, np.zeros(2))
    assert associate_walls(seen, planned, 0.4, 0.07).tolist() == [1]
    alone = WallArrays.of([stub], {}, np.zeros(2))
    assert associate_walls(seen, alone, 0.4, 0.07).tolist() == [-1]
    in_place = WallArrays.of([side("seen", 0.01, 1.0, length=2.5)], {}, np.zeros(2))
    assert associate_walls(in_place, alone, 0.4, 0.07).tolist() == [0]


@pytest.mark.slow
def test_what_no_plan_shows_is_taken_from_the_plan(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc")
    graph = load_bim(building.path, tmp_path).graph
    gone = next(w.source for w in graph.wall_surfaces if w.length and w.length < 4)
    write_plan_without(building.path, [gone], tmp_path / "plan.ifc")
    plan = load_bim(tmp_path / "plan.ifc", tmp_path).graph
    assert {w.source for w in graph.wall_surfaces} - {w.source for w in plan.wall_surfaces} == {gone}
    assert {r.id for r in plan.rooms} == {r.id for r in graph.rooms}
    with pytest.raises(UserError, match="in all"):
        Changes(0.5, 0.4, 0.3)
    run = simulate(
        building.path, STOREY, tmp_path / "run", seed=2, min_rooms=1, min_length=2.0, changes=Changes(unplanned=0.2)
    )
    (change,) = run.changes
    driven = load_bim(tmp_path / "run" / "plan.ifc", tmp_path).graph
    assert change.kind == "unplanned"
    assert {w.source for w in graph.wall_surfaces} - {w.source for w in driven.wall_surfaces} == {change.id}


@pytest.mark.long
@pytest.mark.slow
def test_entered_rooms_without_a_match_are_reported() -> None:
    drive = small_drive()
    _, result = small_run(with_bim=True)
    assert result.anchored and result.matches is not None
    data = ReportData(
        drive.bim.graph, result.s_graph, result.trajectory_map, result.trajectory_odometry, None, result.T_bim_map,
        result.matches, {}, result.deviations,
    )  # fmt: skip
    assert entered_unmatched(data) == []
    s, a, _ = result.matches["rooms"][0]
    less = result.matches | {"rooms": result.matches["rooms"][1:]}
    assert entered_unmatched(replace(data, matches=less)) == [(s, a)]
    assert all(d["reason"] for d in result.deviations)


def test_a_walled_up_door_is_an_extra_wall() -> None:
    """The plan has an opening of 1.6 m, with no door in it, in a wall that was seen to go on through."""
    drive = small_drive()
    graph = drive.bim.graph
    indoors = [w for w in graph.wall_surfaces if w.room is not None]
    longest = max(indoors, key=lambda w: sum(high - low for _, low, high, _ in w.parts))
    source, low, high, _ = max(longest.parts, key=lambda part: part[2] - part[1])
    middle = (low + high) / 2
    opened = replace(longest, parts=((source, low, middle - 0.8, True), (source, middle + 0.8, high, True)))
    plan = replace(graph, wall_surfaces=tuple(opened if w.id == longest.id else w for w in graph.wall_surfaces))
    result = fed(SceneGraphSlam(plan), drive.scans).finish()
    assert result.anchored and result.T_bim_map is not None
    (told,) = [d for d in result.deviations if d["significant"]]
    assert told["kind"] == "extra" and "opening" in told["reason"]
    seen = result.s_graph.surface_by_id[told["s_id"]]
    centre = result.T_bim_map[:2, :2] @ seen.centroid + result.T_bim_map[:2, 3]
    assert abs((centre - longest.centroid) @ np.array(longest.normal)) < 0.03


def test_a_thin_wall_seen_from_both_sides_is_no_furniture() -> None:
    """Neither is seen above 1.6 m: two sides 12 cm apart are a wall's, one alone may be a cupboard's."""
    left, right = side("left", 0.12, 1.0, "", length=2.0), side("right", 0.0, -1.0, "", x=0.2, length=2.0)
    deep = side("deep", -0.4, -1.0, "", length=2.0)
    tall = np.ones(2, dtype=bool)
    assert has_other_side(WallArrays.of([left, right], {}, np.zeros(2)), 0, tall)
    assert has_other_side(WallArrays.of([left, right], {}, np.zeros(2)), 1, tall)
    assert not has_other_side(WallArrays.of([left, deep], {}, np.zeros(2)), 0, tall)
    assert not has_other_side(WallArrays.of([left, right], {}, np.zeros(2)), 0, np.array([True, False]))
    # facing each other across a slit they are no wall
    slit = [side("near", 0.0, 1.0, "", length=2.0), side("far", 0.12, -1.0, "", length=2.0)]
    assert not has_other_side(WallArrays.of(slit, {}, np.zeros(2)), 0, tall)
