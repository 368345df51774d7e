"""The case and the record of a match: one pair and one method."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from evaluation.harness import Case, Cost, Record
from evaluation.matching_benchmark.pairs import DrawnPair, Pair, SlamPair

Status = Literal["unique", "ambiguous", "none", "late", "failed"]


class MatchCase(Case):
    """A pair, a method, and the seconds that it may take. A study overrides `pair` with the kinds of its pairs."""

    pair: Pair
    method: str
    limit_s: float

    def files(self) -> set[str]:
        """The pair's files, and the method's weights if it names a file."""
        weights = self.method.partition("@")[2]
        return self.pair.files() | ({weights} if weights and Path(weights).is_file() else set())


class BenchmarkCase(MatchCase):
    """A match of the matching benchmark."""

    pair: DrawnPair | SlamPair


class Tally(BaseModel):
    """The counts of one pair's rooms or wall surfaces: `right` of the `answered` are true, `true` were to be found.

    `spare` S nodes have no true match; `left` of them are unmatched. `bins` are the confidences of all answers: the
    values of `evaluation.metrics.calibration.Bin`.
    """

    model_config = ConfigDict(frozen=True)

    right: int = 0
    answered: int = 0
    true: int = 0
    spare: int = 0
    left: int = 0
    bins: tuple[tuple[int, int, int, float], ...] = ()


class MatchRecord(Record):
    """The answer of a method. `status` is "late" if the time limit stopped the method, "failed" if it raised.

    `twin`: whether an alternative placement explains the map as well, None if unknown. `rival`: the expected evidence
    (nats) for the truth over the nearest alternative (`matching.ambiguity.symmetries`), None without one. `seconds` is
    the matcher's time, `size` the plan's number of rooms.
    """

    status: Status
    reason: str
    wrong: bool
    twin: bool | None
    rival: float | None
    seconds: Cost
    building: str
    size: int
    s_rooms: int
    s_walls: int
    room_tally: Tally
    wall_tally: Tally
