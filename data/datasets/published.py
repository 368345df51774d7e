"""Public data sets that are run as they are.

The SLAM challenge of Hilti of 2021: LiDAR scans without a plan. Errors are those after alignment. ConSLAM: recordings
of a construction site, month by month (ECCV workshops 2022), with the IFC model and the poses that were published later
as "ConSLAM BIM and GT Poses".
"""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from data.bags import is_bag
from data.common.errors import UserError
from data.common.files import natural_key
from data.datasets.data_set import DataSet, Recording, check_whole
from data.geometry.poses import xyzquat_to_poses
from data.scans.bags import BagScans
from data.scans.sources import open_scans
from data.trajectory import Trajectory

PAGE = "the data set hilti-slam-challenge-2021 of Hilti-Research"
CALIBRATION, LIDAR_TOPIC = "calibration.yaml", "/os_cloud_node/points"
POINTS = {  # (3,) m in the IMU's frame: what the truth's positions are of, from the challenge's own evaluation
    "imu": (0.0, 0.0, 0.0),
    "prism": (-0.00594496, -0.00721288, 0.272943),
    "pole": (-0.00938425, -0.0148401, 1.66722),
}
OF_2026 = ("floor_*/*/run_*", "*/floor_*/*/run_*")  # folders of the challenge of 2026
RECORDINGS = "the recordings of ConSLAM (README of mac137/ConSLAM)"
MODEL = "'ConSLAM BIM and GT Poses' (mediaTUM 1743877)"


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


class Conslam(DataSet):
    """A folder with one IFC file, and for each sequence its scans (`sequence_2.bag`, or a folder `sequence_2` of scans)
    and its poses (`sequence_2.txt`, TUM format). Both downloads are to be put together so."""

    name = "ConSLAM"
    signs = ("[sS]equence_*",)

    def sequences(self) -> list[str]:
        """The recordings with poses; all, if none has any."""
        found = list(self._recordings())
        if not found:
            raise UserError(f"{self.folder}: no sequence_2.bag or the like in it; download {RECORDINGS}")
        return [name for name in found if self._truth(name).exists()] or found

    def check(self, sequence: str) -> None:
        check_whole([self._model(), self._truth(sequence)], f"download it from {MODEL}")
        check_whole([self._recordings()[sequence]], f"download it again from {RECORDINGS}")

    def open(self, sequence: str, work: Path) -> Recording:
        scans = open_scans(self._recordings()[sequence], self.topic)
        return Recording(scans, Trajectory.read_tum(self._truth(sequence)), self._model())

    def _recordings(self) -> dict[str, Path]:
        """Bags and folders by name, in order."""
        found = [path for path in self.folder.glob(self.signs[0]) if path.is_dir() or is_bag(path)]
        return {path.name.removesuffix(".bag"): path for path in sorted(found, key=lambda path: natural_key(path.name))}

    def _model(self) -> Path:
        models = sorted(self.folder.glob("*.ifc"))
        if len(models) != 1:
            raise UserError(f"{self.folder}: {len(models)} IFC files in it; put the one of {MODEL} there")
        return models[0]

    def _truth(self, sequence: str) -> Path:
        return self.folder / f"{sequence}.txt"
