"""The SLAM challenges of Hilti: that of 2021, which has LiDAR scans and no plan, and that of 2026, which has plans and
no LiDAR scans."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.scans.bags import BagScans
from data.trajectory import Trajectory
from evaluation.studies.real.data_set import DataSet, Recording
from evaluation.studies.real.whole_files import check_whole

PAGE_2021 = "the data set hilti-slam-challenge-2021 of Hilti-Research"
CALIBRATION, LIDAR_TOPIC = "calibration.yaml", "/os_cloud_node/points"
POINTS = {  # (3,) m in the IMU's frame: what the truth's positions are of, from the challenge's own evaluation
    "imu": (0.0, 0.0, 0.0), "prism": (-0.00594496, -0.00721288, 0.272943), "pole": (-0.00938425, -0.0148401, 1.66722),
}  # fmt: skip


class Hilti2021(DataSet):
    """Bags `NAME.bag` with truths `NAME_imu.txt`, `NAME_prism.txt` or `NAME_pole.txt` and `calibration.yaml`, in any
    folders. There is no plan: errors are those after alignment, at the truth's stamps."""

    name = "Hilti 2021"
    has_plan = False

    @staticmethod
    def is_in(folder: Path) -> bool:
        """By a truth, whose names are the challenge's."""
        return bool(_truths(folder))

    def sequences(self) -> list[str]:
        """Those with a truth and a bag."""
        found = [name for name in _truths(self.folder) if self._bags(name)]
        if not found:
            bag = f"{next(iter(_truths(self.folder)))}.bag"
            raise UserError(f"{self.folder}: no bag of a sequence with a truth in it; download {bag}: {PAGE_2021}")
        return found

    def check(self, sequence: str) -> None:
        """Bag, truth and calibration."""
        check_whole([_truths(self.folder)[sequence], *self._bags(sequence)], f"download it again: {PAGE_2021}")
        self._imu_from_sensor()

    def open(self, sequence: str, work: Path) -> Recording:
        """The Ouster's scans, unless a topic is given."""
        truth = _truths(self.folder)[sequence]
        point_imu = np.append(POINTS[truth.stem.rpartition("_")[2].lower()], 1.0)
        point = np.linalg.solve(self._imu_from_sensor(), point_imu)[:3]
        scans = BagScans(self._bags(sequence)[0], self.topic or LIDAR_TOPIC)
        return Recording(scans, None, Trajectory.read_tum(truth), point)

    def _bags(self, sequence: str) -> list[Path]:
        return [path for path in sorted(self.folder.rglob("*.bag")) if path.stem.lower() == sequence.lower()]

    def _imu_from_sensor(self) -> NDArray[np.float64]:
        """(4, 4) the Ouster's pose in the IMU's frame."""
        found = sorted(self.folder.rglob(CALIBRATION))
        if not found:
            raise UserError(f"{self.folder}: no {CALIBRATION} in it; download it: {PAGE_2021}")
        try:
            sensors = yaml.safe_load(found[0].read_text())["sensors"]
            return _extrinsics(sensors["os_lidar"]) @ _extrinsics(sensors["os_sensor"])
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError):
            raise UserError(f"{found[0]}: not that challenge's calibration; download it again: {PAGE_2021}") from None


class HiltiTrimble2026(DataSet):
    """Recognised in order to say why it cannot be run."""

    name = "Hilti-Trimble 2026"

    @staticmethod
    def is_in(folder: Path) -> bool:
        """By its folders `floor_X/YYYY-MM-DD/run_Z`."""
        return any(next(folder.glob(pattern), None) for pattern in ("floor_*/*/run_*", "*/floor_*/*/run_*"))

    def sequences(self) -> list[str]:
        """Raises UserError."""
        why = "its bags hold images of two cameras and an IMU, no LiDAR scans, and its floor plans are images"
        raise UserError(f"{self.folder}: {self.name} cannot be run: {why}; give another data set")

    def check(self, sequence: str) -> None:
        """Raises UserError."""
        self.sequences()

    def open(self, sequence: str, work: Path) -> Recording:
        """Raises UserError."""
        raise UserError(f"{self.folder}: {self.name} cannot be run")


def _truths(folder: Path) -> dict[str, Path]:
    found = (path for kind in POINTS for path in sorted(folder.rglob(f"*_{kind}.txt")))
    return {path.stem.rpartition("_")[0]: path for path in found}


def _extrinsics(sensor: dict[str, Any]) -> NDArray[np.float64]:
    """(4, 4) a sensor's pose in its parent's frame, from its translation and its quaternion x y z w."""
    own = sensor["extrinsics"]
    return xyzquat_to_poses([[*map(float, own["translation"]), *map(float, own["quaternion"])]])[0]
