"""The switches of the ablation: what is made harder in a run, and what it is called in the tables."""

from collections.abc import Iterator
from dataclasses import dataclass

from data.common.errors import UserError


@dataclass(frozen=True)
class Conditions:
    """What is made harder; the defaults make nothing so.

    `weaken`: the scans end at a few metres and the odometry's steps are worsened until its own error exceeds 0.5 m
    (`evaluation.harness.weakened`). `moved_walls`: the share of the storey's walls that stand 10 to 30 cm from their
    planned place; `absent_walls`: of those that were never built; `unplanned_walls`: of those that the plan lacks.
    `wrong_matches`: rooms, with their walls, that the matcher's answer gets wrong. `loops`: the whole way is driven
    back again, so that every place is seen twice.
    """

    weaken: bool = False
    moved_walls: float = 0.0
    wrong_matches: int = 0
    loops: bool = False
    absent_walls: float = 0.0
    unplanned_walls: float = 0.0

    def __post_init__(self) -> None:
        """Raises UserError for what cannot be."""
        for kind, share in self._changed.items():
            if not 0 <= share <= 1:
                raise UserError(f"--{kind}-walls {share:g}: a share from 0 to 1 is needed")
        if self.wrong_matches < 0:
            raise UserError(f"--wrong-matches {self.wrong_matches}: must not be negative")

    @property
    def name(self) -> str:
        """For tables and files; `normal` where nothing is made harder."""
        return " ".join(option.removeprefix("--").replace(" ", "-") for option in self.options()) or "normal"

    def options(self) -> Iterator[str]:
        """The command line's options that ask for these conditions."""
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
        """What of them changes the drive itself; a folder's name ends in it."""
        changed = "".join(f"-{kind}{share:g}" for kind, share in self._changed.items() if share)
        return changed + ("-loops" if self.loops else "")

    @property
    def _changed(self) -> dict[str, float]:
        return {"moved": self.moved_walls, "absent": self.absent_walls, "unplanned": self.unplanned_walls}


NORMAL = Conditions()
