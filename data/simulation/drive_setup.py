"""How a simulated drive is set up: who carries which sensor, with which effects, and what is written."""

from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

from data.common.errors import UserError
from data.scans.point_times import Stamped
from data.scans.writers import SCAN_WRITERS, WITH_TIMES
from data.simulation.carriers import Carrier
from data.simulation.drive import Robot
from data.simulation.effects import Timing, checked, timing_of
from data.simulation.imu import ImuModel, imu_named
from data.simulation.run import Settings
from data.simulation.sensor import Sensor
from data.simulation.sensors import described


@dataclass(frozen=True)
class Setup:
    """Who carries which sensor at which height (m) above the floor, with which effects, and what is written."""

    robot: Robot
    sensor: Sensor
    height: float
    effects: frozenset[str]
    timing: Timing
    unit: ImuModel | None
    scan_format: str


def set_up(
    carrier: Carrier, sensor: Sensor, robot: Robot | None, sensor_height: float | None, scan_format: str | None,
    effects: Collection[str], imu: str | None,
) -> Setup:  # fmt: skip
    """What is not given is the carrier's own. Raises UserError for unknown names."""
    from data.simulation.effects.returns import noisy

    chosen = checked(effects)
    timing = timing_of(chosen, carrier.rolling)
    return Setup(
        robot=robot or carrier.robot,
        sensor=noisy(sensor) if "returns" in chosen else sensor,
        height=carrier.height if sensor_height is None else sensor_height,
        effects=chosen,
        timing=timing,
        unit=None if imu is None else imu_named(imu),
        scan_format=scan_format or ("ply" if timing == "rolling" else "bin"),
    )


def check(out: Path, setup: Setup, seed: int, seconds: float | None, stamped: Stamped) -> None:
    """Raises UserError for what cannot be."""
    scan_format = setup.scan_format
    if scan_format not in SCAN_WRITERS:
        raise UserError(f"scan format '{scan_format}' is not known; give one of {', '.join(SCAN_WRITERS)}")
    if setup.timing == "rolling" and scan_format not in WITH_TIMES:
        raise UserError(
            f"the sensor moves during a scan, and {scan_format} files hold no times of points; write "
            f"{' or '.join(WITH_TIMES)}, or leave them out by the effect 'untimed'"
        )
    if setup.timing == "snapshots" and stamped != "start":
        raise UserError(f"a scan of one instant has no {stamped} to stamp; add the effect 'rolling' or 'untimed'")
    if not 0 < setup.height < 10:
        raise UserError(f"a sensor height of {setup.height} m is impossible; give metres above the floor")
    if seconds is not None and not seconds > 0:
        raise UserError(f"a drive of {seconds:g} s is impossible; give more than 0 seconds")
    if seed < 0:
        raise UserError(f"the seed {seed} is negative; give 0 or more")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"{out}: exists and is not an empty folder; give another one")


def settings_of(
    ifc: Path | str, carrier: Carrier, setup: Setup, mount_deg: tuple[float, float, float], imu: str | None
) -> Settings:
    """How the run was made, for run.json."""
    settings: Settings = {
        "bim": Path(ifc).name, "sensor": described(setup.sensor), "robot": asdict(setup.robot),
        "sensor_height_m": setup.height, "rolling": setup.timing != "snapshots",
        "times_told": setup.timing == "rolling", "carrier": carrier.name, "mount_deg": list(mount_deg),
        "effects": sorted(setup.effects),
    }  # fmt: skip
    return settings if imu is None else settings | {"imu": imu}
