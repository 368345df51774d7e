"""What a matcher gets beside the graphs and what it returns: `MatchResult`, the content of `matches.json`."""

from dataclasses import dataclass, field
from typing import Literal, NotRequired, Protocol, TypedDict, cast

import numpy as np
from numpy.typing import NDArray
from pydantic_core import to_jsonable_python

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph

Status = Literal["unique", "ambiguous", "none"]
Pair = tuple[str, str, float]  # S id, A id, confidence in [0, 1]
Start = tuple[float, float, float]  # rough (yaw, x, y) of the map's origin in the BIM frame, as T_a_s: rad and metres
START_M, START_RAD = 3.0, np.radians(60)


class HypothesisEntry(TypedDict):
    """A hypothesis in `matches.json`: `T_a_s` is [yaw, x, y] in rad and m, `rooms` holds pairs [S id, A id]."""

    score: float
    T_a_s: list[float]
    floor: str | None
    rooms: list[list[str]]
    probability: float | None


class MatchesFile(TypedDict):
    """The content of `matches.json`; `rooms` and `wall_surfaces` hold [S id, A id, confidence in [0, 1]].

    `T_a_s` is [yaw, x, y] in rad and m, None if the status is `none`. `floors` maps each S floor to its A floor and is
    only in the file that a run writes.
    """

    status: Status
    reason: str
    rooms: list[list[str | float]]
    wall_surfaces: list[list[str | float]]
    T_a_s: list[float] | None
    floor: str | None
    hypotheses: list[HypothesisEntry]
    seconds: float
    temperature: float
    floors: NotRequired[dict[str, str | None]]


@dataclass(frozen=True)
class Hypothesis:
    """One placement of the S-graph in the A-graph.

    Attributes:
        score: Log likelihood ratio against chance, in nats; higher is better.
        T_a_s: (yaw, x, y) in radians and metres, map frame to BIM frame: p_a = R(yaw) p_s + (x, y).
        floor: Id of the A floor, or None if the A-graph names no floors.
        rooms: Matched rooms as (S id, A id).
        probability: That this is the map's place; what all lack to 1 is that of none of them. None where the method
            computes none.
    """

    score: float
    T_a_s: tuple[float, float, float]
    floor: str | None
    rooms: tuple[tuple[str, str], ...] = ()
    probability: float | None = None

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) `T_a_s` as a motion of space in metres, with z, roll and pitch 0: p_a = matrix @ (x, y, z, 1)."""
        return se2.to_se3(np.array(self.T_a_s))


@dataclass(frozen=True)
class MatchResult:
    """The result of `Matcher.match`.

    Rooms, wall surfaces and hypotheses are given whatever the status is. Only a `unique` result should be relied on.

    Attributes:
        status: `unique` if exactly one placement explains the S-graph, `ambiguous` if several do about equally well,
            `none` if no placement has enough evidence.
        reason: The status explained in one line.
        rooms: Matched rooms of the best hypothesis as (S id, A id, confidence); a confidence is a probability in [0,
            1].
        wall_surfaces: Matched wall surfaces, as `rooms`. Several S surfaces may be matched to one A surface, since a
            map often holds a wall in pieces.
        T_a_s: (yaw, x, y) of the best hypothesis in radians and metres, p_a = R(yaw) p_s + (x, y); None if the status
            is `none`.
        floor: Id of the A floor of the best hypothesis.
        hypotheses: Distinct placements, best first. Two are distinct if they differ in floor, by more than 0.5 m at the
            S-graph's centroid, or by more than 5 degrees.
        seconds: Computation time. Results are compared without it.
        temperature: The nats of score that make one placement of the S-graph e times as likely as one of its mirror
            image. What deviates in both alike cancels, what the plan leaves unexplained does not.
    """

    status: Status
    reason: str
    rooms: tuple[Pair, ...] = ()
    wall_surfaces: tuple[Pair, ...] = ()
    T_a_s: tuple[float, float, float] | None = None
    floor: str | None = None
    hypotheses: tuple[Hypothesis, ...] = ()
    seconds: float = field(default=0.0, compare=False)
    temperature: float = 1.0

    @property
    def matrix(self) -> NDArray[np.float64] | None:
        """(4, 4) `T_a_s` as a motion of space in metres, with z, roll and pitch 0; None if `T_a_s` is.

        `gtsam.Pose3(result.matrix)` is T_bim_map.
        """
        return None if self.T_a_s is None else se2.to_se3(np.array(self.T_a_s))

    def to_dict(self) -> MatchesFile:
        """Returns the result as in `matches.json`."""
        return cast(MatchesFile, to_jsonable_python(self))


class AnyMatcher(Protocol):
    """Any object that finds where an S-graph is in an A-graph; `Matcher.match` says what is expected of it."""

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Matches `s` with `a`; the status is `none` or `ambiguous` if no single answer fits."""


def near_start(start: Start, T_a_s: Array) -> bool:
    """Whether a placement is at most 3 m and 60 degrees from the start."""
    turn = abs(se2.wrap(T_a_s[:1] - start[0])[0])
    return bool(np.hypot(T_a_s[1] - start[1], T_a_s[2] - start[2]) <= START_M and turn <= START_RAD)
