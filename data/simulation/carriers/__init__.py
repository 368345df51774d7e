"""Who carries the sensor along the way, and how it sways, bobs and turns meanwhile."""

from data.simulation.carriers.carrier import Carrier, Motion
from data.simulation.carriers.named import CARRIERS, carrier_named
from data.simulation.carriers.recorded import Recorded
from data.simulation.carriers.shaken import Shaken
from data.simulation.carriers.walking import HANDHELD, POLE, Walker
from data.simulation.carriers.wheeled import WHEELED, Wheeled

__all__ = [
    "CARRIERS",
    "HANDHELD",
    "POLE",
    "WHEELED",
    "Carrier",
    "Motion",
    "Recorded",
    "Shaken",
    "Walker",
    "Wheeled",
    "carrier_named",
]
