"""The base of all settings, and those of tracking: registration, its health, times of points, gravity, floors."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from data.scans.point_times import Stamped


class Settings(BaseModel):
    """Settings are frozen, unknown names are refused, and the docstring below a field describes it."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class TrackingSettings(Settings):
    """Registration of each scan in continuous time to a local map of surfels, its health, and gravity."""

    points: int = Field(2000, ge=100)
    """number of a scan's points that are registered, spread evenly in space"""
    min_range: float = Field(0.3, ge=0)
    """m, minimum range of the points that are used; closer ones show the carrier"""
    max_range: float = Field(60.0, gt=0)
    """m, maximum range of the points that are used"""
    knot_interval: float = Field(0.05, gt=0)
    """s, maximum time for which the motion is taken as constant; a hand can reverse its turn within a scan"""
    speed: float = Field(1.6, gt=0)
    """m/s, standard deviation of the sensor's velocity in each direction; people walk at 1 to 1.6 m/s"""
    speed_memory: float = Field(5.0, gt=0)
    """s, time constant with which an unobserved velocity decays; with `speed`, accelerations of 3 m/s2 for 0.1 s"""
    vertical_speed: float = Field(0.8, gt=0)
    """m/s, standard deviation of the vertical velocity, once the vertical is known; on stairs it is 0.3 to 0.5"""
    sway: float = Field(0.05, gt=0)
    """m, standard deviation of a carried sensor's height over level ground; a hand sways by 0.03"""
    sway_memory: float = Field(2.0, gt=0)
    """s, time in which the usual height counts as observed once, and time constant with which it follows the sensor and
    an unobserved vertical velocity decays; on a stair no level surface may be in view"""
    turn_rate: float = Field(1.0, gt=0)
    """rad/s, standard deviation of the sensor's angular velocity about each axis; handheld it is 0.4 to 1.5"""
    turn_memory: float = Field(0.25, gt=0)
    """s, time constant with which an unobserved angular velocity decays; a hand sways at 1 to 2 Hz"""
    gate: float = Field(1.2, gt=0)
    """m, maximum distance of a point from its surface"""
    kernel: float = Field(0.1, gt=0)
    """m, distance from its surface at which a point's weight is a quarter (Geman-McClure), and within which it counts
    as explained by it; also its standard deviation, larger than a sensor's noise as neighbouring points share errors"""
    spurious: float = Field(3.0, ge=0)
    """information removed along each direction, as a multiple of what errors of the surface normals pretend to give"""
    local_map: float = Field(100.0, gt=0)
    """m, path length after which surfaces that are no longer seen are dropped from the local map"""
    seen_through: float = Field(0.1, gt=0, le=1)
    """share of the surfaces in the way of a suspicious scan's rays that they pass through, above which it is lost; at
    most 0.07 among people, doors and glass, 0.13 at wrong poses"""
    degraded_translation: float = Field(0.1, gt=0)
    """m, standard deviation of the position along any direction above which a scan is degraded"""
    degraded_rotation: float = Field(0.03, gt=0)
    """rad, standard deviation of the attitude about any axis above which a scan is degraded"""
    kidnapped: float = Field(0.5, gt=0)
    """s, time for which lost scans must agree with one another before the sensor counts as carried elsewhere"""
    pause: float = Field(1.0, gt=0)
    """s, maximum time without scans that registration bridges; longer ones count as lost, as after 1.6 s a hand was
    followed to a wrong place"""
    unseen: float = Field(2.0, gt=0)
    """s, time after which a lost sensor begins a new part of the map, wherever it is found again: a person walks two
    metres in that time, and rooms that look alike are farther apart"""
    unconfirmed: float = Field(10.0, ge=0)
    """s, time for which scans wait before they join the map, once a sensor that was lost for `kidnapped` is found
    again: it may be in another room that looks alike; leaving a room takes less"""
    point_times: Literal["auto", "snapshot", "order"] = "auto"
    """point times of scans that have none: `snapshot` is one instant, `order` follows the points' order, `auto` decides
    while tracking"""
    stamp: Stamped = "auto"
    """the instant of a scan that its stamp names, and that its pose is of; `auto` is what the format fixes, else the
    start"""
    gravity_after: float = Field(4.0, gt=0)
    """s, minimum time until the direction of gravity is taken as known; scans wait until then"""
    gravity_until: float = Field(10.0, gt=0)
    """s, time after which the search for gravity ends and the sensor is assumed to be mounted as `mount` says, or
    level"""
    mount: tuple[float, float, float] | None = None
    """degrees, roll, pitch and yaw of the sensor on its carrier, 180,0,0 if upside down; null to estimate them"""


class FloorSettings(Settings):
    """When the sensor leaves a floor, and when it arrives on one."""

    home: float = Field(0.12, gt=0)
    """m, maximum height difference from a known floor at which the sensor is on it; less than a step"""
    storey: float = Field(1.9, gt=0)
    """m, minimum height between two floors; less is a landing, a mezzanine, a ramp or a step"""
