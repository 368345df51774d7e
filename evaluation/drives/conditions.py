"""The conditions of a measurement: how a run is made harder, and the name for the tables."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt

Share = Annotated[float, Field(ge=0, le=1)]


class Conditions(BaseModel):
    """How a run is made harder; by default not at all.

    `weaken`: the range is cut to a few metres and the odometry is degraded until its error exceeds 0.5 m
    (`evaluation.drives.weakened`). `moved_walls`, `absent_walls`, `unplanned_walls`: shares of the storey's walls that
    are built 10 to 30 cm off the plan, not built, and missing in the plan. `wrong_matches`: number of rooms that are
    matched wrongly. `loops`: the whole path is driven back again, so that every place is seen twice.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    weaken: bool = False
    moved_walls: Share = 0.0
    wrong_matches: NonNegativeInt = 0
    loops: bool = False
    absent_walls: Share = 0.0
    unplanned_walls: Share = 0.0

    @property
    def name(self) -> str:
        """The name for tables and files; `normal` by default."""
        chosen = [(name.replace("_", "-"), value) for name, value in self if value]
        return " ".join(name if value is True else f"{name}-{value:g}" for name, value in chosen) or "normal"

    @property
    def of_the_drive(self) -> str:
        """The suffix of the drive's folder: the conditions that change the drive itself."""
        return "".join(
            f"-{name}{value:g}" if name != "loops" else "-loops"
            for name, value in self
            if value and name not in ("weaken", "wrong_matches")
        )


NORMAL = Conditions()
