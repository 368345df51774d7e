"""Verdicts on a column, from both sides of each limit, by rays cast in two rooms."""

import numpy as np
import pytest

from data.plans.elements import PlannedElement
from sgslam.as_built.elements import ElementVerdict, element_verdicts
from tests.helpers.two_rooms_seen import (
    BOTH,
    COLUMN,
    HEIGHT,
    PLAN,
    SHARED,
    SHELL,
    TOLERANCE,
    Floats,
    Places,
    box,
    column,
    planned,
    views_of,
    wall_with_door,
)

LEFT = ((-1.5, 1.2), (-2.0, 1.5), (-1.0, 0.8), (-2.0, 1.8), (-1.2, 1.5))  # of the column


def _column(*built: Floats, places: Places = BOTH, tolerance: float = TOLERANCE) -> ElementVerdict:
    views = views_of(SHELL, wall_with_door(), *built, places=places)
    own = [element for element in planned() if element.kind == "solid"]
    return next(v for v in element_verdicts(own, views, PLAN, tolerance, SHARED) if v.global_id == "column")


@pytest.mark.parametrize(
    ("shift", "places"),
    [((0.1, 0.0), BOTH), ((0.0, -0.1), BOTH), ((-0.3, 0.1), BOTH), ((-0.1, 0.0), LEFT), ((0.1, 0.0), LEFT)],
)
def test_a_displaced_column_is_moved_by_that_vector(shift: tuple[float, float], places: Places) -> None:
    found = _column(column(*shift), places=places)
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    np.testing.assert_allclose(found.offset_m * np.array(found.direction), [*shift, 0.0], atol=0.015)


def test_within_the_tolerance_it_is_as_planned() -> None:
    assert _column(column()).verdict == "as planned"
    assert _column(column(0.03, 0.0)).verdict == "moved"
    within = _column(column(0.03, 0.0), tolerance=0.05)
    assert within.verdict == "as planned" and within.conclusive


@pytest.mark.parametrize("places", [BOTH, LEFT])
def test_a_column_that_is_seen_through_is_absent(places: Places) -> None:
    found = _column(places=places)
    assert found.verdict == "absent" and found.conclusive


def test_things_before_it_do_not_move_it() -> None:
    person = box((0.1, 1.2, 0.0), (0.35, 1.65, 1.8))
    shelf = box((0.1, 0.8, 0.0), (0.35, 2.0, 2.0))
    assert _column(column(), person).verdict == "as planned"
    assert _column(column(), person, places=LEFT).verdict in ("as planned", "uncertain", "not seen")
    assert _column(column(), shelf, places=LEFT).verdict in ("as planned", "uncertain", "not seen")


def test_a_hidden_column_is_not_seen() -> None:
    screen = box((-0.1, -3.0, 0.0), (-0.05, 3.0, HEIGHT))
    assert _column(column(), screen, places=LEFT).verdict == "not seen"
    cladding = box((COLUMN[0] - 0.2, -3.0, 0.0), (COLUMN[0] + 0.2, 3.0, HEIGHT))
    assert _column(column(), cladding, places=LEFT).verdict in ("not seen", "uncertain")


def test_a_column_within_a_wall_is_not_seen() -> None:
    """Whatever stands beside that wall."""
    inside = PlannedElement("column", "IfcColumn", "", "", "solid", box((3.05, 1.4, 0.0), (3.15, 1.5, HEIGHT)))
    own = [element for element in planned() if element.kind == "solid" and element.global_id != "column"]
    post = box((2.8, 1.4, 0.0), (2.9, 1.5, HEIGHT))
    views = views_of(SHELL, wall_with_door(), post)
    assert element_verdicts([*own, inside], views, PLAN, TOLERANCE, SHARED)[-1].verdict == "not seen"
