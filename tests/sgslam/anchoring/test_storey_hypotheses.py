"""Storey hypotheses: which storeys the floors of a map can be, by the heights between them."""

import pytest

from data import Floor
from sgslam.anchoring.storey_hypotheses import assignments

PLANNED = tuple(Floor(name, name, z) for name, z in (("cellar", -3.0), ("ground", 0.0), ("first", 3.0), ("top", 6.5)))
LOW_HIGH = (Floor("low", "", 0.0), Floor("high", "", 3.0))


@pytest.mark.parametrize(
    ("climbed", "planned", "start", "expected"),
    [
        ((0.0,), PLANNED, None, ["cellar", "ground", "first", "top"]),
        ((0.0, 3.1), PLANNED, None, ["cellar ground", "ground first", "first top"]),
        ((0.0, -6.0), PLANNED, None, ["first cellar", "top ground"]),
        ((0.0, 3.1, 6.0), PLANNED, "cellar", ["cellar ground first"]),
        ((0.0, 3.1), PLANNED, "top", []),  # there is nothing above
        ((0.0, 3.59), LOW_HIGH, None, ["low high"]),  # six decimetres off the plan
        ((0.0, 3.61), LOW_HIGH, None, []),
        ((0.0, 2.41), LOW_HIGH, None, ["low high"]),
        ((0.0, 2.39), LOW_HIGH, None, []),
        ((0.0, 0.59), LOW_HIGH, None, ["low low", "high high"]),
        ((0.0, 0.6), LOW_HIGH, None, []),
        ((0.0, 3.1), (*PLANNED, Floor("attic")), None, None),  # without elevations only the start is known
        ((0.0,), (), None, None),
        ((0.0, 3.0), (Floor("a"), Floor("b", "", 0.0)), "a", ["a"]),
    ],
)
def test_storeys_follow_from_the_height_climbed(
    climbed: tuple[float, ...], planned: tuple[Floor, ...], start: str | None, expected: list[str] | None
) -> None:
    found = assignments(dict(enumerate(climbed)), planned, start)
    assert found == (expected if expected is None else [dict(enumerate(way.split())) for way in expected])
