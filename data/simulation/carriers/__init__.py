"""Who carries the sensor along the way, and how it sways, bobs and turns meanwhile."""

from data.simulation.carriers.carrier import WHEELED, Carrier, Motion, shaken
from data.simulation.carriers.recorded import CARRIERS, Recorded, carrier_named
from data.simulation.carriers.walking import HANDHELD, POLE

__all__ = ["CARRIERS", "HANDHELD", "POLE", "WHEELED", "Carrier", "Motion", "Recorded", "carrier_named", "shaken"]
