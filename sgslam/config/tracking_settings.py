"""The settings of tracking: registration in continuous time, its health, times of points, gravity, floors."""

from typing import Literal

from pydantic import Field

from sgslam.config.base import Settings


class TrackingSettings(Settings):
    """Registration of each scan in continuous time to a local map of surfels, its health, and gravity."""

    points: int = Field(2000, ge=100)
    """number of a scan's points that are registered, spread evenly in space"""
    min_range: float = Field(0.3, ge=0)
    """m, shortest range of the points that are used; nearer ones show the carrier"""
    max_range: float = Field(60.0, gt=0)
    """m, longest range of the points that are used"""
    knot_interval: float = Field(0.05, gt=0)
    """s, longest time for which the motion counts as steady; a hand turns its sensor back within a scan"""
    speed: float = Field(1.6, gt=0)
    """m/s, standard deviation of the sensor's velocity in each direction; people walk at 1 to 1.6 m/s"""
    speed_memory: float = Field(5.0, gt=0)
    """s, time constant with which an unobserved velocity decays; with `speed`, accelerations of 3 m/s2 for 0.1 s"""
    vertical_speed: float = Field(0.8, gt=0)
    """m/s, standard deviation of the vertical velocity, once it is known where up is; on stairs it is 0.3 to 0.5"""
    vertical_memory: float = Field(2.0, gt=0)
    """s, time constant with which an unobserved vertical velocity decays; a sensor on a stair may see nothing level"""
    sway: float = Field(0.05, gt=0)
    """m, standard deviation of a carried sensor's height over level ground; a hand sways by 0.03"""
    sway_memory: float = Field(2.0, gt=0)
    """s, time in which the height is taken to be the usual one once, and with which the usual one follows it"""
    turn_rate: float = Field(1.0, gt=0)
    """rad/s, standard deviation of the sensor's rate of turn about each axis; a hand's is 0.4 to 1.5"""
    turn_memory: float = Field(0.25, gt=0)
    """s, time constant with which an unobserved rate of turn decays; a hand sways with 1 to 2 Hz"""
    sigma_point: float = Field(0.1, gt=0)
    """m, standard deviation of a point's distance from its surface, for a weight: neighbouring points share errors"""
    gate: float = Field(1.2, gt=0)
    """m, largest distance of a point from its surface"""
    kernel: float = Field(0.1, gt=0)
    """m, distance from its surface at which a point's weight is a quarter (Geman-McClure)"""
    first_kernel: float = Field(0.25, gt=0)
    """m, the same in the first iteration, for the error of a prediction"""
    wide_kernel: float = Field(0.8, gt=0)
    """m, the same in the first iteration of another attempt, where the prediction was poor"""
    iterations: int = Field(16, ge=1)
    """largest number of Gauss-Newton iterations"""
    convergence: float = Field(5e-4, gt=0)
    """m and rad, update below which the registration stops"""
    feigned: float = Field(3.0, ge=0)
    """information taken away along each direction, as a multiple of what errors of the surfaces' normals feign"""
    local_map: float = Field(100.0, gt=0)
    """m, way after which surfaces that are not seen any more are forgotten"""
    near: float = Field(0.1, gt=0)
    """m, distance within which a point counts as explained by its surface"""
    suspicious: float = Field(0.85, gt=0, le=1)
    """share of the usually explained points below which a registration is tried again, and a lost sensor stays lost"""
    lost: float = Field(0.4, gt=0, le=1)
    """share of the usually explained points below which a scan is lost; a step of 0.7 m into the unknown shows 0.5"""
    seen_through: float = Field(0.1, gt=0, le=1)
    """share of the surfaces that the rays of a suspicious scan meet and pass through, beyond which it is lost; among
    people, doors and glass 0.07 at most; at wrong poses 0.13"""
    usual_memory: float = Field(1.0, gt=0)
    """s, time constant of the usual share of explained points"""
    agreement: float = Field(0.7, gt=0, le=1)
    """share of the points with a surface within `gate` that are `near` it, below which a scan is lost; clutter: 0.9"""
    innovation: float = Field(60.0, gt=0)
    """squared Mahalanobis distance of a pose from its prediction beyond which a scan is lost; chi2 of 6 dimensions"""
    degraded_translation: float = Field(0.1, gt=0)
    """m, standard deviation of a position, along any direction, beyond which a scan is degraded"""
    degraded_rotation: float = Field(0.03, gt=0)
    """rad, standard deviation of an attitude, about any axis, beyond which a scan is degraded"""
    kidnapped: float = Field(0.5, gt=0)
    """s, time for which lost scans must agree with one another until the sensor counts as carried elsewhere"""
    unseen: float = Field(2.0, gt=0)
    """s, time after which a lost sensor begins a new part of the map, wherever it is found again: one walks two metres
    in it, and rooms that look the same are farther apart"""
    unconfirmed: float = Field(10.0, ge=0)
    """s, time for which a sensor that was lost for `kidnapped` and found again may prove to be in a like room instead;
    its scans wait so long until they join the map; one walks out of a room in less"""
    point_times: Literal["auto", "snapshot", "order"] = "auto"
    """times of points of scans without them: one instant, by the points' order, or found out while tracking (auto)"""
    gravity_after: float = Field(4.0, gt=0)
    """s, time after which the direction of gravity is looked for; scans wait until it is known"""
    gravity_until: float = Field(10.0, gt=0)
    """s, time after which the search ends and the sensor is taken to be mounted as stated, or level"""
    mount: tuple[float, float, float] | None = None
    """degrees, roll, pitch and yaw of the sensor on its carrier, 180,0,0 if upside down; found out where not given"""
    mount_error: float = Field(0.5, gt=0)
    """rad, tilt of the sensor from the stated mount beyond which the run warns; a hand sways by less"""


class FloorSettings(Settings):
    """When the sensor leaves a floor, and when it arrives on one."""

    left: float = Field(0.6, gt=0)
    """m, height of the ground above its floor from which a floor is left: more than a raised floor and a hand's sway"""
    flat: float = Field(0.2, gt=0)
    """m, largest change of the sensor's height over level ground, as it is carried"""
    level_way: float = Field(2.0, gt=0)
    """m, length of level way after which a climb has ended; a landing is shorter"""
    home: float = Field(0.12, gt=0)
    """m, height above a known floor at which the sensor is on it; less than a step"""
    climb_drift: float = Field(0.15, ge=0)
    """share of the climbed height that is added to `home`, twice the standard deviation of what a climb drifts"""
    storey: float = Field(1.9, gt=0)
    """m, least height between two floors; less is a landing, a mezzanine, a ramp or a step"""
