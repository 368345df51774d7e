"""Storey hypotheses: which storeys the floors of a map can be, by their heights and by one place for all of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import Floor, SceneGraph, UserError
from matching.result import MatchResult

Floats = NDArray[np.float64]
Assignment = dict[int, str]  # floor of the map -> storey of the plan
_CLIMBED = 0.6  # m by which a climb may differ from the plan's elevations; storeys are further apart
_SAME = 0.75, np.radians(5)  # m and rad between two answers for the same place
_MARGIN = 8.0, 0.1  # over the runner-up: nats, and a share of the evidence
_LISTED = 10  # hypotheses that an answer lists; the score of the last one bounds those beyond


def floor_named(a_graph: SceneGraph, name: str) -> Floor:
    """The storey of that name or id, ignoring case; raises UserError where there is none."""
    for floor in a_graph.floors:
        if name.casefold() in (floor.name.casefold(), floor.id.casefold()):
            return floor
    names = ", ".join(floor.name or floor.id for floor in a_graph.floors) or "none"
    raise UserError(f"storey {name}: no such storey; there are: {names}")


def check_storey(a_graph: SceneGraph, name: str | None) -> None:
    """Raises UserError for an unknown `--storey`; None is accepted."""
    if name is not None:
        try:
            floor_named(a_graph, name)
        except UserError as error:
            raise UserError(f"--{error}") from None


def assignments(heights: dict[int, float], planned: tuple[Floor, ...], start: str | None) -> list[Assignment] | None:
    """The possible storeys of the map's floors, given their heights (m); `start` is the storey of floor 0 if known.

    Where the plan has no elevations: None, or only `start`.
    """
    known = {f.id: f.elevation for f in planned if f.elevation is not None}
    if len(known) < len(planned) or not known:
        return None if start is None else [{0: start}]
    found = []
    for base, elevation in known.items():
        if start is not None and base != start:
            continue
        assigned: Assignment = {}
        for number, height in heights.items():
            z = elevation + height - heights[0]
            nearest = min(known, key=lambda f: abs(known[f] - z))
            if abs(known[nearest] - z) < _CLIMBED:
                assigned[number] = nearest
        if len(assigned) == len(heights):
            found.append(assigned)
    return found


@dataclass(frozen=True)
class JointMatch:
    """The assignment that explains all floors of a map at one place, with each floor's answer on its storey."""

    assigned: Assignment
    answers: dict[int, MatchResult]
    reason: str


@dataclass(frozen=True)
class _Place:
    assigned: Assignment
    T_a_s: Floats  # (3,) yaw x y
    score: float
    supported: int  # floors that have a hypothesis there


def match_jointly(
    graphs: dict[int, SceneGraph], possible: list[Assignment], ask: Callable[[int, str], MatchResult]
) -> JointMatch | None:  # fmt: skip
    """The assignment and place that explain several floors clearly better than any other; None where there is none.

    At least two floors must be informative. `ask` matches a floor with a single storey.
    """
    answers = {(k, f): ask(k, f) for assigned in possible for k, f in assigned.items() if k in graphs}
    informative = {k for k in graphs if any(answers[k, a[k]].status != "none" for a in possible)}
    if len(informative) < 2:
        return None
    hypotheses = {key: _hypotheses(answer) for key, answer in answers.items()}
    places = [p for a in possible for p in _places(graphs, a, informative, hypotheses)]
    places.sort(key=lambda p: -p.score)
    best = places[0]
    others = [p.score for p in places if p.assigned != best.assigned or _differ(graphs, p.T_a_s, best.T_a_s)]
    margin = _MARGIN[0] + _MARGIN[1] * best.score
    if best.supported < len(informative) or (others and max(others) > best.score - margin):
        return None
    own = {k: answers[k, best.assigned[k]] for k in informative}
    fit = [m for m in own.values() if m.status == "unique" and not _differ(graphs, np.array(m.T_a_s), best.T_a_s)]
    if not fit or any(m.status == "none" for m in own.values()):
        return None
    return JointMatch(best.assigned, own, f"{len(informative)} floors together are explained at one place only")


def _places(
    graphs: dict[int, SceneGraph], assigned: Assignment, informative: set[int],
    hypotheses: dict[tuple[int, str], list[tuple[float, Floats]]],
) -> list[_Place]:  # fmt: skip
    """The places of one assignment, each with the evidence of all floors."""
    places: list[_Place] = []
    for _, T in sorted((h for k in informative for h in hypotheses[k, assigned[k]]), key=lambda h: -h[0]):
        if any(not _differ(graphs, T, p.T_a_s) for p in places):
            continue
        score, supported = 0.0, 0
        for k in informative:
            own = hypotheses[k, assigned[k]]
            near = [s for s, at in own if not _differ({k: graphs[k]}, T, at)]
            supported += bool(near)
            score += max(near) if near else own[-1][0] if len(own) >= _LISTED else 0.0
        places.append(_Place(assigned, T, score, supported))
    return places


def _hypotheses(answer: MatchResult) -> list[tuple[float, Floats]]:
    hypotheses = answer.to_dict().get("hypotheses") or ()
    return [(float(h["score"]), np.array(h["T_a_s"], dtype=float)) for h in hypotheses]


def _differ(graphs: dict[int, SceneGraph], a: Floats, b: Floats) -> bool:
    """Whether two places (3,) differ for any of the graphs."""
    turn = (a[0] - b[0] + np.pi) % (2 * np.pi) - np.pi
    if abs(turn) > _SAME[1]:
        return True
    c, s = np.cos([a[0], b[0]]), np.sin([a[0], b[0]])
    for graph in graphs.values():
        x, y = graph.centroid()
        put = np.column_stack([c * x - s * y, s * x + c * y]) + np.stack([a[1:], b[1:]])
        if np.hypot(*(put[0] - put[1])) > _SAME[0]:
            return True
    return False
