"""What a matcher answers: `MatchResult`, whose `to_dict` is the form of `matches.json`."""

from dataclasses import dataclass, field
from typing import Literal, NotRequired, TypedDict

Status = Literal["unique", "ambiguous", "none"]
Pair = tuple[str, str, float]  # S id, A id, confidence in [0, 1]


class HypothesisEntry(TypedDict):
    """A hypothesis in `matches.json`: `T_a_s` is [yaw, x, y] in rad and m, `rooms` are [S id, A id]."""

    score: float
    T_a_s: list[float]
    floor: str | None
    rooms: list[list[str]]


class MatchesFile(TypedDict):
    """The form of `matches.json`; `rooms` and `wall_surfaces` are [S id, A id, confidence in [0, 1]].

    `T_a_s` is [yaw, x, y] in rad and m, None where the status is `none`. `floors` is there in a run's file alone: the A
    floor of each S floor.
    """

    status: Status
    reason: str
    rooms: list[list[str | float]]
    wall_surfaces: list[list[str | float]]
    T_a_s: list[float] | None
    floor: str | None
    hypotheses: list[HypothesisEntry]
    seconds: float
    floors: NotRequired[dict[str, str | None]]


@dataclass(frozen=True)
class Hypothesis:
    """One way to place the S-graph in the A-graph: `T_a_s` = (yaw, x, y), p_a = R(yaw) p_s + (x, y).

    `score` is the log likelihood ratio against chance, in nats; higher is better. `rooms` are (S id, A id).
    """

    score: float
    T_a_s: tuple[float, float, float]
    floor: str | None
    rooms: tuple[tuple[str, str], ...] = ()

    def to_dict(self) -> HypothesisEntry:
        """The form within `matches.json`."""
        rooms = [list(pair) for pair in self.rooms]
        return {"score": self.score, "T_a_s": list(self.T_a_s), "floor": self.floor, "rooms": rooms}


@dataclass(frozen=True)
class MatchResult:
    """The answer of `Matcher.match`.

    `rooms` and `wall_surfaces` are those of the first hypothesis, (S id, A id, confidence), whatever the
    status is; only a `unique` answer is fit to be committed to. `T_a_s` is None where the status is `none`.
    """

    status: Status
    reason: str
    rooms: tuple[Pair, ...] = ()
    wall_surfaces: tuple[Pair, ...] = ()
    T_a_s: tuple[float, float, float] | None = None
    floor: str | None = None
    hypotheses: tuple[Hypothesis, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    def to_dict(self) -> MatchesFile:
        """The form of `matches.json`."""
        return {
            "status": self.status,
            "reason": self.reason,
            "rooms": [list(pair) for pair in self.rooms],
            "wall_surfaces": [list(pair) for pair in self.wall_surfaces],
            "T_a_s": None if self.T_a_s is None else list(self.T_a_s),
            "floor": self.floor,
            "hypotheses": [h.to_dict() for h in self.hypotheses],
            "seconds": self.seconds,
        }
