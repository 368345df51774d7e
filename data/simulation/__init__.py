"""A simulated LiDAR on a robot that drives through a building."""

from data.simulation.changes import Change, Changes
from data.simulation.drive import Robot
from data.simulation.sensor import SpinningSensor
from data.simulation.simulate import SimulatedRun

__all__ = [
    "Change",
    "Changes",
    "Robot",
    "SimulatedRun",
    "SpinningSensor",
]
