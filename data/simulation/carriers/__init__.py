"""Who carries the sensor along the way, and how it sways, bobs and turns meanwhile."""

from data.simulation.carriers.carried import CARRIERS, HANDHELD, POLE, Recorded, carrier_named
from data.simulation.carriers.carrier import WHEELED, Carrier, Motion, shaken

__all__ = ["CARRIERS", "HANDHELD", "POLE", "WHEELED", "Carrier", "Motion", "Recorded", "carrier_named", "shaken"]
