"""Signals that separate sound maps from lost ones, each with its value and its limit; and those of a placed map.

In lost runs the map and the odometry disagree, keyframes see no walls, the plan is tilted in the map, or the way
leads through planned walls, though a place in the plan may explain the map.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.geometry.poses import poses_to_xyzquat
from data.trajectory import Trajectory
from sgslam.anchoring.place_posterior import PlacePosterior
from sgslam.anchoring.soundness import LAPLACE, Soundness
from sgslam.config import QualitySettings
from sgslam.geometry.trajectory_errors import rmse_aligned
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty
from sgslam.session.soundness.standing_walls import walls_crossed

Floats = NDArray[np.float64]
_APART = 1.0  # m: crossings nearer to each other are of one wall, which has two faces


@dataclass(frozen=True)
class Signal:
    """A quality signal of the map; `ok` if the value is within its limit."""

    value: float
    limit: float
    ok: bool


Quality = dict[str, Signal]


@dataclass(frozen=True, eq=False)
class PlaceReport:
    """What is known of the places, whether the map is `sound` at the best one, and the `signals` that tell.

    `T_bim_map` (4, 4) is that place, if the map was anchored there, until it proved improbable too.
    """

    posterior: PlacePosterior
    sound: Soundness = field(default_factory=lambda: Soundness(1.0, {}))
    signals: Mapping[str, float] = field(default_factory=dict)
    T_bim_map: Floats | None = None

    @property
    def probability(self) -> float:
        """That the map is at the best place and sound."""
        return self.posterior.two_best[0][0] * self.sound.probability

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, with the `outside` probability that the map is at none of the places."""
        (_, storey), (runner_up, runner_up_storey) = self.posterior.two_best
        T, nats = self.T_bim_map, self.sound.nats
        return {
            "probability": self.probability,
            "storey": storey,
            "runner_up": runner_up,
            "runner_up_storey": runner_up_storey,
            "outside": self.posterior.outside,
            "mirrored": self.posterior.mirrored,
            "sound": self.sound.probability,
            "signals": {name: {"value": value, "nats": nats.get(name)} for name, value in self.signals.items()},
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
        }


def quality_of(
    in_map: Trajectory,
    odometry: Trajectory,
    begins: list[int],
    walls_seen: list[int],
    uncertainty: ScanUncertainty,
    lost: float,
    unplaced: float,
    settings: QualitySettings,
) -> Quality:
    """The signals of a run with these trajectories, at the same stamps, and numbers of walls seen from its keyframes.
    The odometry begins again at the scans `begins`. `lost` is the share of the scans that are lost, of those in parts
    that were not placed too; `unplaced` is the share of the scans in such parts.

    - `map_against_odometry`: how far the map's trajectory and the odometry's differ, aligned, as a share of the way.
    - `lost_scans`, `unplaced_scans`, `keyframes_without_walls`: shares.
    - `walls_per_keyframe`: the mean number of walls seen.
    - `position_sigma_m`: below which the standard deviation of 95 % of the positions lies: of the anchored scans, or of
      all where none is.
    """
    sigma = np.linalg.norm(uncertainty.sigma[:, :3], axis=1)
    known = sigma[np.isfinite(sigma) & (uncertainty.anchored if uncertainty.anchored.any() else True)]
    at_most = {
        "map_against_odometry": _difference(in_map, odometry, begins) / max(in_map.length, 1.0),
        "lost_scans": lost,
        "unplaced_scans": unplaced,
        "keyframes_without_walls": float(np.mean([count == 0 for count in walls_seen])),
    }
    found = {name: _at_most(value, getattr(settings, name)) for name, value in at_most.items()}
    found["walls_per_keyframe"] = at_least(float(np.mean(walls_seen)), settings.walls_per_keyframe)
    if len(known):
        found["position_sigma_m"] = _at_most(float(np.quantile(known, 0.95)), settings.position_sigma)
    return found


def placed_signals(
    quality: Quality,
    in_map: Trajectory,
    begins: list[int],
    uncertainty: ScanUncertainty,
    T_bim_map: Floats,
    standing: SceneGraph,
    walls_looked_through: float,
) -> dict[str, float]:
    """The signals of a map with a place in the plan that tell whether it is sound.

    Beside some of its quality, these are `plan_tilt_deg`, the angle between the verticals of plan and map, and of the
    walls that are `standing`, those of the plan that the map has, `planned_walls_crossed`, at how many places its way
    leads through them, and the share of `walls_looked_through`. A sliding door may be planned as a wall.
    """
    found = {name: own.value for name, own in quality.items() if name in LAPLACE}
    positions = in_map.transformed(T_bim_map).positions
    places = [walls_crossed(positions[own], standing) for own in _followed(uncertainty.anchored, begins)]
    crossed = np.concatenate([np.empty((0, 2)), *places])
    near = shapely.union_all(shapely.buffer(shapely.points(crossed), _APART / 2))
    distinct = 0 if near.is_empty else int(shapely.get_num_geometries(near))
    tilt = float(np.degrees(np.arccos(np.clip(T_bim_map[2, 2], -1.0, 1.0))))
    of_plan = {"plan_tilt_deg": tilt, "planned_walls_crossed": float(distinct)}
    return {**found, **of_plan, "walls_looked_through": walls_looked_through}


def contradiction(probability: float, sound: Soundness, signals: Mapping[str, float], withdraw: float) -> str | None:
    """One line, of a map whose place is not probable enough to keep; None of others."""
    if probability >= withdraw:
        return None
    name = min(sound.nats, key=lambda own: sound.nats[own])
    what = {
        "planned_walls_crossed": "the path crosses {:.0f} walls that both have",
        "plan_tilt_deg": "it is tilted by {:.1f} degrees in the map",
        "map_against_odometry": "the map differs from the odometry by {:.1%} of the way",
        "walls_looked_through": "its rays lead through {:.0%} of the walls that both have",
        "position_sigma_m": "its positions have a standard deviation of {:.2f} m",
    }[name].format(signals[name])
    right = f"the probability that it is right is {100 * probability:.1f} %"
    return f"the map fits the plan, but {what}: {right}, and anchors.withdraw asks for {100 * withdraw:g} %"


def _at_most(value: float, limit: float) -> Signal:
    return Signal(value, limit, bool(value <= limit))


def at_least(value: float, limit: float) -> Signal:
    """A signal that is sound from its limit on."""
    return Signal(value, limit, bool(value >= limit))


def _difference(in_map: Trajectory, odometry: Trajectory, begins: list[int]) -> float:
    """The RMSE (m) of the positions, each piece of the odometry aligned; a piece that hardly moves has no error."""
    squares, number = 0.0, np.arange(len(in_map))
    for begin, end in zip(begins, [*begins[1:], len(in_map)], strict=True):
        piece = (number >= begin) & (number < end)
        with suppress(UserError):
            squares += (end - begin) * rmse_aligned(odometry.only(piece), in_map.only(piece)) ** 2
    return float(np.sqrt(squares / len(in_map)))


def _followed(anchored: NDArray[np.bool_], begins: list[int]) -> list[NDArray[np.intp]]:
    """The pieces of the run, as numbers of scans, in which no scan is left out and the odometry does not begin again:
    nothing is known of the way between them."""
    own = np.flatnonzero(anchored)
    cuts = np.flatnonzero((np.diff(own) > 1) | np.isin(own[1:], begins)) + 1
    return [piece for piece in np.split(own, cuts) if len(piece) > 1]
