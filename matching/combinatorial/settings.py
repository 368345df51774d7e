"""The two published parameter sets of iS-Graphs' search."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Gaussian:
    """exp(-x^2 / 2 sigma^2), and 0 from `bound` on."""

    sigma: float
    bound: float


@dataclass(frozen=True)
class Planes:
    """How two pairs of walls are compared: by the distance of their points (metres), by the angle of their normals."""

    distance: Gaussian
    angle: Gaussian


@dataclass(frozen=True)
class CombinatorialSettings:
    """The parameters of the search. Lengths in metres, angles in radians.

    `limit_s` is the time limit of a match. A set of pairs is kept from the affinities `least_rooms`, `least_walls` (of
    one room), `least_interlevel` (of a wall with its room) and `least_global` on. `restarts` is the number of random
    starts for each set.
    """

    limit_s: float = 60.0
    rooms: Gaussian = Gaussian(0.1, 0.6)
    planes: Planes = Planes(Gaussian(0.5, 0.5), Gaussian(0.10, 0.35))
    least_rooms: float = 0.85
    least_walls: float = 0.85
    least_interlevel: float = 0.85
    least_global: float = 0.85
    restarts: int = 1
    tie: float = 0.01  # solutions whose consistency differs by no more are as good as each other
    storeys_apart: bool = True  # rooms are points in space; otherwise in the plane
    partial_walls: bool = False  # a wall that does not fit its room is left out; otherwise its whole set is
    about_best: bool = False  # solutions are judged about the room with the best wall set; otherwise the first one
    upright_only: bool = False  # the plan turned by more than about 11 degrees, or mirrored, is refused
    deviated: Planes | None = None  # walls that were left over are paired by these bounds
    least_deviated: float = 0.3


DEVELOP = CombinatorialSettings()
"""The released matcher."""

GRID = CombinatorialSettings(
    rooms=Gaussian(0.2, 0.2), planes=Planes(Gaussian(0.5, 0.2), Gaussian(0.1, 0.1)), least_rooms=0.15,
    least_walls=0.2, least_interlevel=0.2, least_global=0.8, restarts=10, storeys_apart=False, partial_walls=True,
    about_best=True, upright_only=True, deviated=Planes(Gaussian(0.5, 0.1), Gaussian(0.1, 0.2)),
)  # fmt: skip
"""The later branch that tolerates walls that were not built as planned."""
