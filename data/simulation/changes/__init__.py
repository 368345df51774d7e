"""How a storey's walls, doors, windows and columns differ from the plan: elsewhere, not built, or not planned."""

from dataclasses import dataclass
from typing import Literal

from data.common.errors import UserError

MOST = 0.3  # m that a wall is moved, or something else displaced


@dataclass(frozen=True)
class Changes:
    """The shares of a storey's walls, openings and columns that differ from the plan, 0 to 1 each.

    Of the walls (IfcWall), `moved` are moved across, by `moved_by` metres or by 10 to 30 cm each; `absent` are left
    out, `unplanned` missing in the plan. Of the doors and windows in openings of these walls, `openings_displaced` are
    displaced along their wall; `openings_filled` are absent, and their wall goes on there. Of the columns (IfcColumn),
    `columns_displaced` are displaced in any horizontal direction, `columns_absent` left out. Whatever is displaced is
    so by `displaced_by` metres.
    """

    moved: float = 0.0
    absent: float = 0.0
    unplanned: float = 0.0
    moved_by: float | None = None
    openings_displaced: float = 0.0
    openings_filled: float = 0.0
    columns_displaced: float = 0.0
    columns_absent: float = 0.0
    displaced_by: float = 0.1

    def __post_init__(self) -> None:
        """Raises UserError for impossible shares and distances."""
        if self.moved_by is not None and not 0 < self.moved_by <= MOST:
            raise UserError(f"walls moved by {self.moved_by:g} m: give more than 0, and at most {MOST:g}")
        if not 0 < self.displaced_by <= MOST:
            raise UserError(f"displaced by {self.displaced_by:g} m: give more than 0, and at most {MOST:g}")
        shares = (self.moved, self.absent, self.unplanned)
        if not _are_shares(shares):
            message = f"moved ({self.moved:g}), absent ({self.absent:g}) and unplanned ({self.unplanned:g})"
            raise UserError(f"shares of {message} walls: give 0 to 1 in all")
        if not _are_shares((self.openings_displaced, self.openings_filled)):
            message = f"displaced ({self.openings_displaced:g}) and filled ({self.openings_filled:g})"
            raise UserError(f"shares of {message} openings: give 0 to 1 in all")
        if not _are_shares((self.columns_displaced, self.columns_absent)):
            message = f"displaced ({self.columns_displaced:g}) and absent ({self.columns_absent:g})"
            raise UserError(f"shares of {message} columns: give 0 to 1 in all")

    @property
    def any(self) -> bool:
        """Whether anything changes."""
        walls = (self.moved, self.absent, self.unplanned)
        openings = (self.openings_displaced, self.openings_filled)
        return any((*walls, *openings, self.columns_displaced, self.columns_absent))


@dataclass(frozen=True)
class Change:
    """What happened to the wall, door, window or column with this GlobalId.

    Walls are `moved`, `absent` or `unplanned`, doors and windows `displaced` or `filled`, columns `displaced` or
    `absent`. `offset_in_bim` is the shift (x, y) in metres of what is moved or displaced.
    """

    id: str
    kind: Literal["moved", "absent", "unplanned", "displaced", "filled"]
    offset_in_bim: tuple[float, float] = (0.0, 0.0)


def _are_shares(shares: tuple[float, ...]) -> bool:
    return min(shares) >= 0 and sum(shares) <= 1


AS_PLANNED = Changes()
