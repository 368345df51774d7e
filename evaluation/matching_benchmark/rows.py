"""The rows of the matching benchmark: a line of JSON for each pair and method, appended as they are computed."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Protocol

from data.common.errors import UserError
from evaluation.metrics.calibration import Bin

FILE = "rows.jsonl"
ORACLE = "oracle"  # the method that is given the true place
# the names of three noise models in files: published rows hold them, and the draws are seeded by them
WRITTEN_AS = {"mis_segmented": "messy", "heavy_drift": "warped", "negative": "elsewhere"}
_READ_AS = {written: name for name, written in WRITTEN_AS.items()}


def written_as(regime: str) -> str:
    """The name of a noise model in rows and in seeds; the same one for most."""
    return WRITTEN_AS.get(regime, regime)


@dataclass(frozen=True)
class Tally:
    """The counts of one pair's rooms or wall surfaces: `right` of the `answered` are true, `true` were to be found.

    `spare` S nodes have no true match; `left` of them are unmatched. `bins` are the confidences of all answers.
    """

    right: int = 0
    answered: int = 0
    true: int = 0
    spare: int = 0
    left: int = 0
    bins: tuple[Bin, ...] = ()


@dataclass(frozen=True)
class Row:
    """One pair and one method. `rooms` is the number of rooms seen (None: all), `size` the plan's number of rooms.

    `source` is the plan that the S-graph was drawn from. `status` is the answer's, "late" if the time limit stopped the
    method, "failed" if it raised. `twin`: whether an alternative placement explains the map as well, None if unknown.
    `rival`: the expected evidence (nats) for the truth over the nearest alternative (`matching.ambiguity.symmetries`),
    None without one. `seconds` is the matcher's time.
    """

    method: str
    regime: str
    plans: str
    plan: str
    building: str
    source: str
    rooms: int | None
    index: int
    seed: int
    size: int
    s_rooms: int
    s_walls: int
    status: str
    reason: str
    wrong: bool
    twin: bool | None
    rival: float | None
    seconds: float
    room_tally: Tally
    wall_tally: Tally

    @property
    def key(self) -> tuple[Any, ...]:
        """The identity of the row."""
        return self.method, self.regime, self.plans, self.plan, self.source, self.rooms, self.index, self.seed

    @property
    def completed(self) -> bool:
        """Whether the method answered within the time limit."""
        return self.status not in ("late", "failed")


class Append(Protocol):
    """Adds one row to the file."""

    def __call__(self, row: Row) -> None:
        """Writes the row at once."""


def read_rows(path: Path) -> list[Row]:
    """All rows of the file, the last one for each key; empty without a file. An incomplete last line is ignored. Raises
    UserError for an invalid line."""
    if not path.exists():
        return []
    rows = {}
    lines = path.read_text().split("\n")[:-1]
    for number, line in enumerate(lines, 1):
        try:
            row = _row(json.loads(line))
        except (ValueError, KeyError, TypeError):
            raise UserError(f"{path}:{number}: not a row of this version; give another --out") from None
        rows[row.key] = row
    return list(rows.values())


@contextmanager
def appending(path: Path) -> Iterator[Append]:
    """Opens the file for appending rows; an incomplete last line is removed first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        file.seek(0)
        whole = file.read().rfind(b"\n") + 1
        file.truncate(whole)

        def append(row: Row) -> None:
            file.write((json.dumps(_plain(row), separators=(",", ":"), allow_nan=False) + "\n").encode())
            file.flush()
            os.fsync(file.fileno())

        yield append


def _plain(row: Row) -> dict[str, Any]:
    plain = {f.name: getattr(row, f.name) for f in fields(row)}
    plain["regime"] = written_as(row.regime)
    return plain | {of: astuple(plain[of]) for of in ("room_tally", "wall_tally")}


def _row(value: dict[str, Any]) -> Row:
    def tally(of: list[Any]) -> Tally:
        right, answered, true, spare, left, bins = of
        return Tally(right, answered, true, spare, left, tuple(Bin(*b) for b in bins))

    regime = _READ_AS.get(value["regime"], value["regime"])
    return Row(**value | {"regime": regime} | {of: tally(value[of]) for of in ("room_tally", "wall_tally")})
