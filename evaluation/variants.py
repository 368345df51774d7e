"""What is run on the scans of a case: the system, with a part left out or replaced, its tracker alone, or a peer."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from data.common.errors import UserError
from data.imu import ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory
from evaluation.peers.lidar_inertial import genz_lio_alone, rko_lio_alone
from evaluation.peers.odometries import kiss_icp_alone, small_gicp_alone


@dataclass(frozen=True)
class Variant:
    """The system with a `plan` or without, a `matcher` (a method of `Matcher.load`, or `oracle`), and settings that
    differ from the defaults; with a second pass, with the samples of the IMU, and `weakened`: with poses of its own
    odometry, made worse, as given ones, and with a short range of the sensor."""

    plan: bool = True
    matcher: str = ""
    second_pass: bool = True
    imu: bool = False
    weakened: bool = False
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


SYSTEM: dict[str, Variant] = {
    "anchored": Variant(),
    "unanchored": Variant(plan=False),
    "voting": Variant(matcher="voting"),
    "learned": Variant(matcher="learned"),
    "published": Variant(matcher="paper@published"),
    "oracle": Variant(matcher="oracle"),
    "walls only": Variant(settings={"anchors": {"rooms": False}}),
    "rooms only": Variant(settings={"anchors": {"planes": False}}),
    "single pass": Variant(second_pass=False),
    "no adjustment": Variant(settings={"anchors": {"points": False}}),
    "with IMU": Variant(imu=True),
    "KISS-ICP inside": Variant(settings={"odometry": {"method": "kiss"}}),
    "small_gicp inside": Variant(settings={"odometry": {"method": "small_gicp"}}),
    "weakened": Variant(weakened=True),
    "weakened, voting": Variant(weakened=True, matcher="voting"),
    "weakened, unanchored": Variant(weakened=True, plan=False),
}
TRACKERS = ("tracking", "tracking with IMU")  # ours, as a run without a plan uses it
Track = Callable[[Iterable[Scan], ImuSamples | None], Trajectory]
ODOMETRIES: dict[str, Track] = {
    "KISS-ICP": lambda scans, _: kiss_icp_alone(scans),
    "small_gicp": lambda scans, _: small_gicp_alone(scans),
    "RKO-LIO": lambda scans, samples: rko_lio_alone(scans, _given(samples)),
    "GenZ-LIO": lambda scans, samples: genz_lio_alone(scans, _given(samples)),
}
ICP_TO_BIM = "ICP to the BIM"
PEERS = (*ODOMETRIES, ICP_TO_BIM)


def variant_named(name: str) -> Variant:
    """A variant of the system; `anchored@METHOD` has that matcher. Raises UserError for an unknown one."""
    kind, at, method = name.partition("@")
    if at and kind == "anchored":
        return Variant(matcher=method)
    if name not in SYSTEM:
        known = ", ".join((*SYSTEM, *TRACKERS, *PEERS, "anchored@METHOD"))
        raise UserError(f"no variant '{name}'; there are {known}")
    return SYSTEM[name]


def _given(samples: ImuSamples | None) -> ImuSamples:
    if samples is None:
        raise UserError("a LiDAR-inertial odometry needs an IMU; name one in the case")
    return samples
