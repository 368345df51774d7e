"""The switches of the ablation: what is made harder in a run, and what it is called in the tables."""

from collections.abc import Iterator
from dataclasses import dataclass

from data.errors import UserError


@dataclass(frozen=True)
class Conditions:
    """What is made harder; the defaults make nothing so.

    `weaken`: the scans end at a few metres and the odometry's steps are worsened until its own error exceeds 0.5 m
    (`evaluation.weakened`). `moved_walls`: the share of the storey's walls that stand 10 to 30 cm from their planned
    place. `wrong_matches`: rooms, with their walls, that the matcher's answer gets wrong. `loops`: the whole way is
    driven back again, so that every place is seen twice.
    """

    weaken: bool = False
    moved_walls: float = 0.0
    wrong_matches: int = 0
    loops: bool = False

    def __post_init__(self) -> None:
        """Raises UserError for what cannot be."""
        if not 0 <= self.moved_walls <= 1:
            raise UserError(f"--moved-walls {self.moved_walls:g}: a share from 0 to 1 is needed")
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
        if self.moved_walls:
            yield f"--moved-walls {self.moved_walls:g}"
        if self.wrong_matches:
            yield f"--wrong-matches {self.wrong_matches}"
        if self.loops:
            yield "--loops"

    @property
    def of_the_drive(self) -> str:
        """What of them changes the drive itself; a folder's name ends in it."""
        return (f"-moved{self.moved_walls:g}" if self.moved_walls else "") + ("-loops" if self.loops else "")


NORMAL = Conditions()
