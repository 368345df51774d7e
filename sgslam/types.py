"""The records of one scan on its way through the system, as they pass from room to room.

`RawScan` (checked) -> `TimedPoints` (thinned) -> `Registration` (with its `Motion`) -> `TrackedScan` -> a keyframe.
"""

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Health = Literal["good", "degraded", "lost"]
NO_PLAN = "no plan was given"  # the reason of a run that only makes a map


@dataclass(frozen=True, eq=False)
class RawScan:
    """An unprocessed scan: points (N, 3) in the sensor frame, with optional times (N,), in seconds after the stamp, and
    T_odom_sensor (4, 4) of an external odometry, with the covariance (6, 6) of its motion since the scan before."""

    stamp_ns: int
    points: Floats
    point_times: Floats | None
    T_odom_sensor: Floats | None
    step_covariance: Floats | None = None


@dataclass(frozen=True, eq=False)
class TimedPoints:
    """Points (N, 6) of a scan that are used, in the sensor frame, measured at `seconds` (N,).

    Their first three columns are places, the others normals of the scan's surfaces there; zero where it shows none.

    `knot_seconds` (K,) divide the scan into pieces of steady motion; one knot for a snapshot. `plane_of` (N,) are the
    surfels of the local map that the points lie on, as far as known.
    """

    points: Floats
    seconds: Floats
    knot_seconds: Floats
    plane_of: NDArray[np.int32]

    def later(self, seconds: float) -> "TimedPoints":
        """The same points, measured so many seconds later."""
        return TimedPoints(self.points, self.seconds + seconds, self.knot_seconds + seconds, self.plane_of)


@dataclass(frozen=True, eq=False)
class UnsteadyTurn:
    """Rotation `vectors` (S, 3) at `seconds` (S,), ascending: the attitude relative to that of a steady turn between
    knots, in the sensor's axes."""

    seconds: Floats
    vectors: Floats

    def later(self, seconds: float) -> "UnsteadyTurn":
        """The same, so many seconds later."""
        return UnsteadyTurn(self.seconds + seconds, self.vectors)


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of the sensor in `odom`: `knots` (K, 4, 4) at `seconds` (K,), ascending; steady motion between them."""

    seconds: Floats
    knots: Floats

    def later(self, seconds: float) -> "Motion":
        """The same motion, so many seconds later."""
        return replace(self, seconds=self.seconds + seconds)


@dataclass(frozen=True, eq=False)
class Registration:
    """The result of registering a scan: `T_odom_sensor` (4, 4) at its stamp, and how good it is.

    `covariance` (6, 6) is that of the pose relative to the local map, rotation (rad) first, then translation (m), in
    the sensor's axes. `health` is "degraded" if only the motion prior constrains some directions, which are the unit
    twists `unconstrained` (M, 6), rotation first, in the sensor's axes; it is "lost" if the scan does not fit the map,
    and the pose is then a prediction. `share` is the share of the scan's points that are on known surfaces. `motion` is
    the motion during the scan, by seconds after its stamp; `point_times` (N,) are the times that were used, None for a
    snapshot. With an IMU, `unsteady` is what it measures of the turns within the scan, by the same seconds. A scan
    `is_after_pause` if none came for long before it, and nothing else measured how the sensor moved. `used` are the
    points that were registered, by the same seconds; None where an external odometry chose them.
    """

    T_odom_sensor: Floats
    covariance: Floats
    health: Health
    share: float
    motion: Motion
    point_times: Floats | None = None
    unconstrained: Floats = field(default_factory=lambda: np.empty((0, 6)))
    unsteady: UnsteadyTurn | None = None
    is_after_pause: bool = False
    used: TimedPoints | None = None


@dataclass(frozen=True, eq=False)
class TrackedScan:
    """A scan with its pose `T_odom_sensor` (4, 4) at its stamp, in a level frame.

    `registration` is in the odometry's frame; its covariance is that of the pose against the odometry's map. Where the
    sensor was carried elsewhere, the first scan there `begins_elsewhere`: another level frame, and another map.
    """

    raw: RawScan
    registration: Registration
    T_odom_sensor: Floats
    begins_elsewhere: bool = False

    @property
    def health(self) -> Health:
        """How the scan fits the odometry's map."""
        return self.registration.health

    @property
    def covariance(self) -> Floats:
        """(6, 6), rotation first, in the sensor's axes."""
        return self.registration.covariance


@dataclass(frozen=True)
class Update:
    """The live estimate right after a scan.

    `T_map_sensor` (4, 4) is the sensor's pose in the map frame (metres) at `stamp_ns` (nanoseconds). It is not smoothed
    yet, and provisional until gravity is known and while scans are lost; `Result` has the final poses. `keyframes` is
    the number of keyframes so far, `anchored` whether the map is anchored to the plan. `T_bim_sensor` (4, 4) is the
    pose in the BIM frame, None while the map is not anchored; `health` is the tracker's verdict on the newest scan,
    None while it waits. After a longer loss it stays lost until a place that looks alike is ruled out.
    `SceneGraphSlam.sigma` gives the standard deviations of the pose.
    """

    stamp_ns: int
    T_map_sensor: Floats
    keyframes: int
    anchored: bool
    T_bim_sensor: Floats | None = None
    health: Health | None = None


@dataclass(frozen=True)
class Relocalisation:
    """Whether a run was relocalised in the prior map, `found_s` seconds after its start, and the reason. `found_s` is
    None if it was not, or only after the last scan."""

    found: bool
    found_s: float | None
    reason: str


@dataclass(frozen=True)
class HeldOutWall:
    """How far a mapped wall is off the planned surface `a_id`, in a map that knows nothing of that wall's place."""

    a_id: str
    offset_m: float
    sigma_m: float


@dataclass(frozen=True)
class ControlResidual:
    """How far (m) the map has a control point off its coordinates, along x, y and z of the BIM frame; `sigmas` is the
    largest of them in standard deviations. Beyond three it `contradicts`: either it or the map is wrong there."""

    name: str
    residual_m: tuple[float, float, float]
    sigma_m: float
    sigmas: float
    contradicts: bool


@dataclass(frozen=True)
class MapCheck:
    """How an anchored map agrees with walls that were held out of it, and with control points, to which it was fitted
    unless they lie far off."""

    held_out: tuple[HeldOutWall, ...] = ()
    control: tuple[ControlResidual, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As JSON values: `held_out`, None without such walls, and `control`."""
        walls, summary = self.held_out, None
        if walls:
            offsets, sigmas = (np.array([getattr(w, name) for w in walls]) for name in ("offset_m", "sigma_m"))
            summary = {
                "walls": len(walls),
                "rms_m": float(np.sqrt(np.mean(offsets**2))),
                "within_95": float(np.mean(np.abs(offsets) <= 1.96 * sigmas)),
                "worst": asdict(walls[int(np.argmax(np.abs(offsets)))]),
            }
        return {"held_out": summary, "control": [asdict(own) for own in self.control]}
