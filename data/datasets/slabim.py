"""SLABIM, public scans of a university building with its BIM, converted to the input of `sgslam.run`.

H. Huang, Z. Qiao, Z. Yu, C. Liu, S. Shen, F. Zhang, H. Yin: SLABIM: A SLAM-BIM Coupled Dataset in HKUST Main Building.
ICRA 2025. These files are read:

    BIM/<storey>/mesh/walls.ply, floors.ply, columns.ply          metres, z up
    sensor_data/<storey>_<region>/points/data/<frame>.pcd         sensor frame, metres
    sensor_data/<storey>_<region>/points/timestamps.txt           a line for each scan, seconds
    sensor_data/<storey>_<region>/points/pose_frame_to_bim.txt    `t x y z qx qy qz qw`, T_bim_sensor
"""

import os
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.common.files import natural_key, numbered_lines, write_atomically
from data.datasets.data_set import DataSet, Recording, check_whole
from data.plans.mesh_plan import read_mesh
from data.scans import ScanFolder
from data.scans.formats import READERS
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds, seconds_to_ns

PARTS, MORE_PARTS = ("walls.ply", "floors.ply"), ("columns.ply",)  # doors are left out: they stand open
LEAST_MOTION_M = 0.01
PAGE = "the links of the README of HKUST-Aerial-Robotics/SLABIM, or the data set BobH62/SLABIM"


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
            raise UserError(f"{sessions}: no session with its points in it; {first} ({PAGE})")
        return found

    def check(self, sequence: str) -> None:
        if sequence not in (there := self.sequences()):
            raise UserError(f"{self.folder}: no session {sequence}; there are: {', '.join(there)}")
        mesh, points = self._places(sequence)
        check_whole((mesh / part for part in PARTS), f"unpack BIM.zip again ({PAGE})")
        texts = points / "timestamps.txt", points / "pose_frame_to_bim.txt"
        check_whole((*texts, points / "data"), f"unpack sensor_data/{sequence}.zip again ({PAGE})")
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
        scans = [p for p in (points / "data").iterdir() if p.suffix.lower() in READERS and not p.name.startswith(".")]
        stamps = _stamps(points / "timestamps.txt")
        if len(stamps) != len(scans):
            raise UserError(f"{points / 'timestamps.txt'}: {len(stamps)} stamps for {len(scans)} scans")
        return dict(zip(sorted(scans, key=lambda p: natural_key(p.name)), stamps, strict=True))


def _stamps(path: Path) -> list[int]:
    """Stamps from the last number of each line, seconds or integer nanoseconds."""
    stamps = []
    for number, text in numbered_lines(path, "one stamp per scan"):
        last = (text.replace(",", " ").split() or [""])[-1]
        try:
            whole = last.isdecimal() and int(last) >= 1_000_000 * NS
            stamps.append(int(last) if whole else seconds_to_ns(last))
        except ValueError as error:
            raise UserError(f"{path}, line {number}: {error}") from None
    return stamps


def _truth(points: Path) -> Trajectory:
    """T_bim_sensor; an early release has identical poses, since its scans are in the building's frame."""
    path = points / "pose_frame_to_bim.txt"
    truth = Trajectory.read_tum(path)
    if len(truth) > 1 and np.ptp(truth.positions, axis=0).max() < LEAST_MOTION_M:
        raise UserError(f"{path}: all poses are the same; use the later release of the data set, with moving poses")
    return truth
