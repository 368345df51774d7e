"""Room relocalisation: single rooms of a map, matched with a known map that lacks the others."""

from dataclasses import replace

import numpy as np
import pytest
from plans import Polygon, a_graph, box, merged

from data import Keyframe, SceneGraph
from data.geometry import se2
from data.scene_graph.motion import moved
from matching import Matcher, MatchResult
from sgslam.anchoring.room_relocalisation import relocalise_by_rooms
from sgslam.config import AnchorSettings

LAB: Polygon = [(0, 0), (6, 0), (6, 2.2), (7.5, 2.2), (7.5, 5), (3.1, 5), (3.1, 4.2), (0, 4.2)]
STORE: Polygon = [(0, 5.2), (2.9, 5.2), (2.9, 9), (1.3, 9), (1.3, 8.1), (0, 8.1)]
SIX: Polygon = [(30, 0), (32, 0), (32, 2), (39, 2), (39, 6), (30, 6)]
FIVE: Polygon = [(40, 0), (44, 0), (44, 4), (42, 5), (40, 4)]
BEYOND = [box(7.7, 0, 4, 4.5), box(7.7, 4.7, 6, 3), box(11.9, 0, 3, 4.5)]
KNOWN = a_graph([LAB, STORE, box(-6.2, 0, 6, 4.2), box(-6.2, 4.4, 6, 3)])
PLACE = np.array([0.7, 12.0, -5.0])  # of the known map in the seen one


def shifted(polygon: Polygon, x: float, y: float) -> Polygon:
    return [(u + x, v + y) for u, v in polygon]


def relocalised(s: SceneGraph, known: SceneGraph = KNOWN) -> tuple[MatchResult | None, list[str]]:
    """The answer about the rooms of a map, and which of them were matched."""
    asked, matcher = [], Matcher.load("learned")

    def ask(graph: SceneGraph) -> MatchResult:
        asked.extend(room.id for room in graph.rooms)
        return matcher.match(graph, known)

    return relocalise_by_rooms(s, ask, lambda _: known, AnchorSettings()), asked


def test_one_recognised_room_places_a_map_whose_other_rooms_are_unknown() -> None:
    found, _ = relocalised(moved(a_graph([LAB, *BEYOND]), PLACE))
    assert found is not None and found.status == "unique" and found.T_a_s is not None
    assert np.allclose(se2.compose(np.array(found.T_a_s), PLACE), 0.0, atol=0.02)
    assert {(s, a) for s, a, _ in found.wall_surfaces} == {(f"room0/{k}", f"room0/{k}") for k in range(len(LAB))}


@pytest.mark.parametrize(
    ("seen", "known"),
    [
        (BEYOND, KNOWN),
        ([LAB, shifted(STORE, 0.0, 6.0)], KNOWN),  # the store is recognised elsewhere
        ([LAB, box(-4.5, 1.0, 3.0, 2.5)], KNOWN),  # walls in the midst of a known room
        ([LAB, *BEYOND], a_graph([LAB, shifted(LAB, 20.0, 3.0), box(-6.2, 0, 6, 4.2)])),  # which is there twice
    ],
    ids=["unknown rooms", "a room elsewhere", "a conflict", "a room that is there twice"],
)
def test_a_doubtful_room_gives_no_answer(seen: list[Polygon], known: SceneGraph) -> None:
    assert relocalised(moved(a_graph(seen), PLACE), known)[0] is None


def test_the_evidence_is_that_of_the_room_that_has_most() -> None:
    nats = []
    for seen in ([LAB], [STORE], [LAB, STORE]):
        found, _ = relocalised(a_graph(seen))
        assert found is not None
        nats.append(int(found.reason.split(" nats")[0].split()[-1]))
    assert nats[2] == max(nats[:2]) > min(nats[:2])


def test_five_rooms_of_six_walls_or_more_are_matched_the_nearest_to_the_robot_first() -> None:
    six = a_graph([shifted(SIX, 20.0 * k, 30.0) for k in range(7)], prefix="six")
    _, asked = relocalised(merged(a_graph([FIVE, *BEYOND], prefix="other"), six))
    assert len(asked) == 5 and all(name.startswith("six") for name in asked)
    for x, is_found in ((3.0, True), (160.0, False)):
        s = replace(merged(a_graph([LAB]), six), keyframes=(Keyframe("k", 0, (x, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0)),))
        found, asked = relocalised(s)
        assert (found is not None) is is_found and len(asked) == 5
