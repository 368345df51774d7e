"""A simulated LiDAR, carried through a building by a robot or a person."""

from data.simulation.changes import Change, Changes
from data.simulation.drive import Robot
from data.simulation.sensor import Sensor
from data.simulation.simulate import SimulatedRun

__all__ = [
    "Change",
    "Changes",
    "Robot",
    "Sensor",
    "SimulatedRun",
]
