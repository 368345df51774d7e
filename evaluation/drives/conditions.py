"""The conditions of a measurement: how a run is made harder, and the name for the tables."""

from collections.abc import Iterator
from dataclasses import dataclass

from data.common.errors import UserError


@dataclass(frozen=True)
class Conditions:
    """How a run is made harder; by default not at all.

    `weaken`: the range is cut to a few metres and the odometry is degraded until its error exceeds 0.5 m
    (`evaluation.drives.weakened`). `moved_walls`, `absent_walls`, `unplanned_walls`: shares of the storey's walls that
    are built 10 to 30 cm off the plan, not built, and missing in the plan. `wrong_matches`: number of rooms that are
    matched wrongly. `loops`: the whole path is driven back again, so that every place is seen twice.
    """

    weaken: bool = False
    moved_walls: float = 0.0
    wrong_matches: int = 0
    loops: bool = False
    absent_walls: float = 0.0
    unplanned_walls: float = 0.0

    def __post_init__(self) -> None:
        """Raises UserError for invalid values."""
        for kind, share in self._changed.items():
            if not 0 <= share <= 1:
                raise UserError(f"--{kind}-walls {share:g}: the share must be from 0 to 1")
        if self.wrong_matches < 0:
            raise UserError(f"--wrong-matches {self.wrong_matches}: must not be negative")

    @property
    def name(self) -> str:
        """The name for tables and files; `normal` by default."""
        return " ".join(option.removeprefix("--").replace(" ", "-") for option in self.options()) or "normal"

    def options(self) -> Iterator[str]:
        """The command-line options for these conditions."""
        if self.weaken:
            yield "--weaken"
        for kind, share in self._changed.items():
            if share:
                yield f"--{kind}-walls {share:g}"
        if self.wrong_matches:
            yield f"--wrong-matches {self.wrong_matches}"
        if self.loops:
            yield "--loops"

    @property
    def of_the_drive(self) -> str:
        """The suffix of the drive's folder: the conditions that change the drive itself."""
        changed = "".join(f"-{kind}{share:g}" for kind, share in self._changed.items() if share)
        return changed + ("-loops" if self.loops else "")

    @property
    def _changed(self) -> dict[str, float]:
        return {"moved": self.moved_walls, "absent": self.absent_walls, "unplanned": self.unplanned_walls}


NORMAL = Conditions()
