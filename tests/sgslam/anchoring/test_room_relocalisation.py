"""Room relocalisation: single rooms of a map, matched with a known map that lacks the others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from test_free_space_conflict import a_room, graph

from data import Keyframe, Room, SceneGraph, WallSurface
from data.geometry import se2
from matching import Matcher, MatchResult
from sgslam.anchoring.room_relocalisation import MAX_ROOMS, relocalise_by_rooms
from sgslam.config import AnchorSettings

Corners = list[tuple[float, float]]
LAB: Corners = [(0, 0), (6, 0), (6, 2.2), (7.5, 2.2), (7.5, 5), (3.1, 5), (3.1, 4.2), (0, 4.2)]
STORE: Corners = [(0, 5.2), (2.9, 5.2), (2.9, 9), (1.3, 9), (1.3, 8.1), (0, 8.1)]
BEYOND = [a_room("b", 7.7, 0, 4, 4.5), a_room("c", 7.7, 4.7, 6, 3), a_room("d", 11.9, 0, 3, 4.5)]
PLACE = (0.7, 12.0, -5.0)  # of the known map in the seen one


def walled(name: str, corners: Corners) -> tuple[Room, list[WallSurface]]:
    """A room with a wall surface between any two of its corners, which go round to the left."""
    walls = []
    for k, (p, q) in enumerate(zip(np.array(corners), np.roll(corners, -1, axis=0), strict=True)):
        along = (q - p) / np.linalg.norm(q - p)
        (x, y), (nx, ny) = ((p + q) / 2).tolist(), (-along[1], along[0])
        walls.append(WallSurface(f"{name}/{k}", name, (x, y), (float(nx), float(ny)), float(np.linalg.norm(q - p))))
    return Room(name, tuple(np.mean(corners, axis=0).tolist()), polygon=tuple(corners)), walls


KNOWN = graph(walled("lab", LAB), walled("store", STORE), a_room("a", -6.2, 0, 6, 4.2), a_room("e", -6.2, 4.4, 6, 3))


def relocalised(*seen: tuple[Room, list[WallSurface]], known: SceneGraph = KNOWN) -> MatchResult | None:
    s, matcher = graph(*seen, T=PLACE), Matcher.load("learned")
    return relocalise_by_rooms(s, partial(matcher.match, a=known), lambda _: known, AnchorSettings())


def test_one_recognised_room_places_a_map_whose_other_rooms_are_unknown() -> None:
    found = relocalised(walled("lab", LAB), *BEYOND)
    assert found is not None and found.status == "unique" and found.T_a_s is not None
    assert np.allclose(se2.compose(np.array(found.T_a_s), np.array(PLACE)), 0.0, atol=0.02)
    assert {(s, a) for s, a, _ in found.wall_surfaces} == {(f"lab/{k}", f"lab/{k}") for k in range(len(LAB))}
    assert relocalised(*BEYOND) is None


def moved(corners: Corners, x: float, y: float) -> Corners:
    return [(u + x, v + y) for u, v in corners]


@pytest.mark.parametrize(
    "other", [walled("store", moved(STORE, 0.0, 6.0)), a_room("hall", -4.5, 1.0, 3.0, 2.5)],
    ids=["a room elsewhere", "walls in the midst of a known room"],
)  # fmt: skip
def test_a_conflict_with_a_room_leaves_no_answer(other: tuple[Room, list[WallSurface]]) -> None:
    assert relocalised(walled("lab", LAB), walled("store", STORE)) is not None
    assert relocalised(walled("lab", LAB), other) is None


def test_a_room_that_the_known_map_has_twice_is_not_recognised() -> None:
    twice = graph(walled("lab", LAB), walled("copy", moved(LAB, 20.0, 3.0)), a_room("a", -6.2, 0, 6, 4.2))
    assert relocalised(walled("lab", LAB), *BEYOND, known=twice) is None


def test_five_rooms_of_six_walls_or_more_are_asked_for() -> None:
    six = [walled(f"six{k}", moved(STORE, 20.0 * k, 30.0)) for k in range(7)]
    five: Corners = [(40, 0), (44, 0), (44, 4), (42, 5), (40, 4)]
    asked: list[str] = []

    def ask(s: SceneGraph) -> MatchResult:
        asked.extend(room.id for room in s.rooms)
        return Matcher.load("learned").match(s, KNOWN)

    relocalise_by_rooms(graph(walled("five", five), *BEYOND, *six), ask, lambda _: KNOWN, AnchorSettings())
    assert len(asked) == 5 and all(name.startswith("six") for name in asked)


def test_the_evidence_is_that_of_the_room_that_has_most() -> None:
    nats = []
    for seen in ([walled("lab", LAB)], [walled("store", STORE)], [walled("lab", LAB), walled("store", STORE)]):
        found = relocalised(*seen)
        assert found is not None
        nats.append(int(found.reason.split(" nats")[0].split()[-1]))
    assert nats[2] == max(nats[:2]) > min(nats[:2])


def test_the_rooms_near_the_robot_are_matched() -> None:
    far = [walled(f"far{k}", moved([(0, 0), (2 + k / 3, 0), (2 + k / 3, 2), (9, 2), (9, 6), (0, 6)], 30 + 10 * k, 0))
           for k in range(MAX_ROOMS)]  # fmt: skip
    s, matcher = graph(walled("lab", LAB), *far), Matcher.load("learned")

    def asked_from(x: float) -> MatchResult | None:
        seen = replace(s, keyframes=(Keyframe("k", 0, (x, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0)),))
        return relocalise_by_rooms(seen, partial(matcher.match, a=KNOWN), lambda _: KNOWN, AnchorSettings())

    assert asked_from(3.0) is not None and asked_from(60.0) is None
