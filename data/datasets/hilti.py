"""The SLAM challenge of Hilti of 2021: LiDAR scans without a plan. Errors are those after alignment."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from data.common.errors import UserError
from data.datasets.data_set import DataSet, Recording, check_whole
from data.geometry.poses import xyzquat_to_poses
from data.scans.bags import BagScans
from data.trajectory import Trajectory

PAGE = "the data set hilti-slam-challenge-2021 of Hilti-Research"
CALIBRATION, LIDAR_TOPIC = "calibration.yaml", "/os_cloud_node/points"
POINTS = {  # (3,) m in the IMU's frame: what the truth's positions are of, from the challenge's own evaluation
    "imu": (0.0, 0.0, 0.0),
    "prism": (-0.00594496, -0.00721288, 0.272943),
    "pole": (-0.00938425, -0.0148401, 1.66722),
}
OF_2026 = ("floor_*/*/run_*", "*/floor_*/*/run_*")  # folders of the challenge of 2026


class Hilti2021(DataSet):
    """Bags `NAME.bag` with truths `NAME_imu.txt`, `NAME_prism.txt` or `NAME_pole.txt` and `calibration.yaml`, in any
    folders."""

    name = "Hilti 2021"
    signs = (*(f"**/*_{point}.txt" for point in POINTS), *OF_2026)
    has_plan = False

    def sequences(self) -> list[str]:
        """Those with a truth and a bag. Raises UserError for the challenge of 2026."""
        if any(next(self.folder.glob(pattern), None) for pattern in OF_2026):
            why = "its bags hold images of two cameras and an IMU, no LiDAR scans, and its floor plans are images"
            raise UserError(f"{self.folder}: Hilti-Trimble 2026 cannot be run: {why}; give another data set")
        truths = self._truths()
        found = [name for name in truths if self._bags(name)]
        if not found:
            raise UserError(f"{self.folder}: no bag with a truth in it; download {next(iter(truths))}.bag: {PAGE}")
        return found

    def check(self, sequence: str) -> None:
        check_whole([self._truths()[sequence], *self._bags(sequence)], f"download it again: {PAGE}")
        self._imu_from_sensor()

    def open(self, sequence: str, work: Path) -> Recording:
        """The Ouster's scans, unless a topic is given."""
        truth = self._truths()[sequence]
        point_imu = np.append(POINTS[truth.stem.rpartition("_")[2].lower()], 1.0)
        point = np.linalg.solve(self._imu_from_sensor(), point_imu)[:3]
        scans = BagScans(self._bags(sequence)[0], self.topic or LIDAR_TOPIC)
        return Recording(scans, Trajectory.read_tum(truth), point=point)

    def _truths(self) -> dict[str, Path]:
        found = (path for kind in POINTS for path in sorted(self.folder.rglob(f"*_{kind}.txt")))
        return {path.stem.rpartition("_")[0]: path for path in found}

    def _bags(self, sequence: str) -> list[Path]:
        return [path for path in sorted(self.folder.rglob("*.bag")) if path.stem.lower() == sequence.lower()]

    def _imu_from_sensor(self) -> NDArray[np.float64]:
        """(4, 4) the Ouster's pose in the IMU's frame."""
        found = sorted(self.folder.rglob(CALIBRATION))
        if not found:
            raise UserError(f"{self.folder}: no {CALIBRATION} in it; download it: {PAGE}")
        try:
            sensors = yaml.safe_load(found[0].read_text())["sensors"]
            return _extrinsics(sensors["os_lidar"]) @ _extrinsics(sensors["os_sensor"])
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError):
            raise UserError(f"{found[0]}: not that challenge's calibration; download it again: {PAGE}") from None


def _extrinsics(sensor: dict[str, Any]) -> NDArray[np.float64]:
    """(4, 4) a sensor's pose in its parent's frame, from its translation and its quaternion x y z w."""
    pose = sensor["extrinsics"]
    return xyzquat_to_poses([[*map(float, pose["translation"]), *map(float, pose["quaternion"])]])[0]
