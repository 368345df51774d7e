"""Carriers by name, or from a recording."""

from pathlib import Path

from data.common.errors import UserError
from data.simulation.carriers.carrier import Carrier
from data.simulation.carriers.recorded import Recorded
from data.simulation.carriers.walking import HANDHELD, POLE
from data.simulation.carriers.wheeled import WHEELED

CARRIERS: dict[str, Carrier] = {"wheeled": WHEELED, "handheld": HANDHELD, "pole": POLE}


def carrier_named(name: str, pace: float = 1.0, reverse: bool = False) -> Carrier:
    """The carrier of this name, or the motion in this TUM file, at a factor of its pace, or played from its end.

    Raises UserError for what is neither, and for a pace of a carrier that is not recorded.
    """
    if name in CARRIERS:
        if pace != 1.0 or reverse:
            raise UserError(f"carrier {name} is not a recording: leave out pace and reversed")
        return CARRIERS[name]
    if Path(name).suffix != ".tum":
        raise UserError(f"carrier '{name}' is not known; give {', '.join(CARRIERS)}, or a trajectory FILE.tum")
    return Recorded.read(name, pace, reverse)
