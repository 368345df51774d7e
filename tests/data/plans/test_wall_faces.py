"""Which surfaces of a plan are faces of one wall."""

import pytest

from data.scene_graph import WallSurface
from data.scene_graph.wall_faces import wall_names

Xy = tuple[float, float]


def face(id: str, centroid: Xy, normal: Xy, source: str = "", length: float = 4.0) -> WallSurface:
    return WallSurface(id, None, centroid, normal, length, source=source)


def walls(*surfaces: WallSurface) -> set[frozenset[str]]:
    names = wall_names(surfaces)
    return {frozenset(s for s, own in names.items() if own == name) for name in names.values()}


def test_a_source_is_a_wall_wherever_its_faces_are() -> None:
    found = walls(face("a", (0, 0), (1, 0), "w1"), face("b", (9, 9), (0, 1), "w1"), face("c", (0, 0), (1, 0), "w2"))
    assert found == {frozenset("ab"), frozenset("c")}


@pytest.mark.parametrize(
    ("centroid", "normal", "together"),
    [
        ((-0.2, 1.0), (-1, 0), True),  # the other side
        ((-0.8, 1.0), (-1, 0), False),  # thicker than a wall
        ((0.3, 1.0), (-1, 0), False),  # they face each other
        ((-0.2, 4.5), (-1, 0), False),  # beyond its end
        ((0.01, 30.0), (1, 0), True),  # in line
        ((0.05, 30.0), (1, 0), False),  # not in line
        ((0.0, 1.0), (0, 1), False),  # across
    ],
)
def test_without_sources_the_place_tells(centroid: Xy, normal: Xy, together: bool) -> None:
    for reverse in (False, True):
        pair = [face("a", (0, 0), (1, 0)), face("b", centroid, normal)][:: -1 if reverse else 1]
        assert walls(*pair) == ({frozenset("ab")} if together else {frozenset("a"), frozenset("b")})


def test_faces_that_share_a_third_are_one_wall_and_sources_stay_apart() -> None:
    chain = [face("a", (0, 0), (1, 0)), face("b", (-0.2, 0), (-1, 0)), face("c", (-0.2, 9), (-1, 0))]
    assert walls(*chain, face("d", (0, 0), (1, 0), "w")) == {frozenset("abc"), frozenset("d")}
    assert wall_names([]) == {}
