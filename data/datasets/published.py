"""Public data sets that are run as they are, or converted.

The SLAM challenge of Hilti of 2021: LiDAR scans without a plan. Errors are those after alignment. ConSLAM: recordings
of a construction site, month by month (ECCV workshops 2022), with the IFC model and the poses that were published later
as "ConSLAM BIM and GT Poses". SLABIM: scans of a university building with its BIM.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from data.bags import is_bag
from data.common.errors import UserError
from data.common.files import natural_key, parsed_lines, write_atomically
from data.datasets.data_set import DataSet, Recording, check_whole
from data.geometry.poses import xyzquat_to_poses
from data.plans.mesh_plan import read_mesh
from data.scans import ScanFolder
from data.scans.bags import BagScans
from data.scans.formats import is_scan
from data.scans.sources import open_scans
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds, seconds_to_ns

HILTI = "the data set hilti-slam-challenge-2021 of Hilti-Research"
CALIBRATION, LIDAR_TOPIC = "calibration.yaml", "/os_cloud_node/points"
POINTS = {  # (3,) m in the IMU's frame: what the truth's positions are of, from the challenge's own evaluation
    "imu": (0.0, 0.0, 0.0),
    "prism": (-0.00594496, -0.00721288, 0.272943),
    "pole": (-0.00938425, -0.0148401, 1.66722),
}
OF_2026 = ("floor_*/*/run_*", "*/floor_*/*/run_*")  # folders of the challenge of 2026
RECORDINGS = "the recordings of ConSLAM (README of mac137/ConSLAM)"
MODEL = "'ConSLAM BIM and GT Poses' (mediaTUM 1743877)"
PARTS, MORE_PARTS = ("walls.ply", "floors.ply"), ("columns.ply",)  # doors are left out: they stand open
LEAST_MOTION_M = 0.01
SLABIM = "the links of the README of HKUST-Aerial-Robotics/SLABIM, or the data set BobH62/SLABIM"


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
            raise UserError(f"{self.folder}: no bag with a truth in it; download {next(iter(truths))}.bag: {HILTI}")
        return found

    def check(self, sequence: str) -> None:
        check_whole([self._truths()[sequence], *self._bags(sequence)], f"download it again: {HILTI}")
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
            raise UserError(f"{self.folder}: no {CALIBRATION} in it; download it: {HILTI}")
        try:
            sensors = yaml.safe_load(found[0].read_text())["sensors"]
            return _extrinsics(sensors["os_lidar"]) @ _extrinsics(sensors["os_sensor"])
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError):
            raise UserError(f"{found[0]}: not that challenge's calibration; download it again: {HILTI}") from None


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


class Slabim(DataSet):
    """The folder with `BIM` and `sensor_data`; a session, such as `3F_Region1`, is run with its storey's meshes."""

    name = "SLABIM"
    signs = ("sensor_data", "BIM", "BIM.zip")

    def sequences(self) -> list[str]:
        sessions = self.folder / "sensor_data"
        found = sorted(path.parent.name for path in sessions.glob("*/points"))
        if not found:
            archive = next(iter(sorted(sessions.glob("*.zip"))), None)
            first = "download 3F_Region1.zip or another one" if archive is None else f"unpack {archive.name}"
            raise UserError(f"{sessions}: no session with its points in it; {first} ({SLABIM})")
        return found

    def check(self, sequence: str) -> None:
        if sequence not in (there := self.sequences()):
            raise UserError(f"{self.folder}: no session {sequence}; there are: {', '.join(there)}")
        mesh, points = self._places(sequence)
        check_whole((mesh / part for part in PARTS), f"unpack BIM.zip again ({SLABIM})")
        texts = points / "timestamps.txt", points / "pose_frame_to_bim.txt"
        check_whole((*texts, points / "data"), f"unpack sensor_data/{sequence}.zip again ({SLABIM})")
        self._scans(points)
        _truth(points)

    def open(self, sequence: str, work: Path) -> Recording:
        """Lays the session out in `work`."""
        laid = work / f"slabim-{sequence}"
        truth = self.lay_out(sequence, laid)
        return Recording(ScanFolder(laid / "scans"), truth, laid / "a_graph.json")

    def lay_out(self, sequence: str, out: Path) -> Trajectory:
        """Writes `scans` (links and times.txt), `a_graph.json`, `truth.tum`, and `sequence.yaml`, a list with it
        for the study of real recordings; returns T_bim_sensor.

        Existing files are replaced. Raises UserError as `check` does, and if the meshes are not of a building.
        """
        self.check(sequence)
        mesh, points = self._places(sequence)
        graph = read_mesh(*(mesh / part for part in (*PARTS, *MORE_PARTS) if (mesh / part).is_file())).graph
        folder = out / "scans"
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.iterdir():
            if old.is_symlink():
                old.unlink()
        scans = self._scans(points)
        for scan in scans:
            os.symlink(scan.resolve(), folder / scan.name)
        write_atomically(folder / "times.txt", "".join(f"{ns_to_seconds(stamp)}\n" for stamp in scans.values()))
        truth = _truth(points)
        truth.write_tum(out / "truth.tum")
        graph.save(out / "a_graph.json")
        files = {"bim": "a_graph.json", "scans": "scans", "truth": "truth.tum"}
        lines = "".join(f"  {key}: {(out / file).resolve()}\n" for key, file in files.items())
        write_atomically(out / "sequence.yaml", f"- name: {sequence}\n{lines}")
        return truth

    def _places(self, sequence: str) -> tuple[Path, Path]:
        """The folders of the storey's meshes and of the session's points."""
        mesh = self.folder / "BIM" / sequence.partition("_")[0] / "mesh"
        return mesh, self.folder / "sensor_data" / sequence / "points"

    def _scans(self, points: Path) -> dict[Path, int]:
        """The scans in order with their stamps (ns). Raises UserError."""
        scans = list(filter(is_scan, (points / "data").iterdir()))
        stamps = _stamps(points / "timestamps.txt")
        if len(stamps) != len(scans):
            raise UserError(f"{points / 'timestamps.txt'}: {len(stamps)} stamps for {len(scans)} scans")
        return dict(zip(sorted(scans, key=lambda p: natural_key(p.name)), stamps, strict=True))


def _stamps(path: Path) -> list[int]:
    """Stamps from the last number of each line, seconds or integer nanoseconds."""

    def stamp(text: str) -> int:
        last = text.replace(",", " ").split()[-1]
        return int(last) if last.isdecimal() and int(last) >= 1_000_000 * NS else seconds_to_ns(last)

    return parsed_lines(path, "one stamp per scan", stamp)


def _truth(points: Path) -> Trajectory:
    """T_bim_sensor; an early release has identical poses, since its scans are in the building's frame."""
    path = points / "pose_frame_to_bim.txt"
    truth = Trajectory.read_tum(path)
    if len(truth) > 1 and np.ptp(truth.positions, axis=0).max() < LEAST_MOTION_M:
        raise UserError(f"{path}: all poses are the same; use the later release of the data set, with moving poses")
    return truth
