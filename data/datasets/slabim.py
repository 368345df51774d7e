"""SLABIM, public scans of a university building with its BIM, converted to the input of `sgslam.run`.

H. Huang, Z. Qiao, Z. Yu, C. Liu, S. Shen, F. Zhang, H. Yin: SLABIM: A SLAM-BIM Coupled Dataset in HKUST Main Building.
ICRA 2025. These files are read:

    BIM/<storey>/mesh/walls.ply, floors.ply, columns.ply          metres, z up
    sensor_data/<storey>_<region>/points/data/<frame>.pcd         sensor frame, metres
    sensor_data/<storey>_<region>/points/timestamps.txt           a line for each scan, seconds
    sensor_data/<storey>_<region>/points/pose_frame_to_bim.txt    `t x y z qx qy qz qw`, T_bim_sensor
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.common.files import natural_key, write_atomically
from data.datasets.data_set import DataSet, Recording, check_whole
from data.plans.mesh_plan import read_mesh
from data.scans import ScanFolder
from data.scans.formats import READERS
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, ns_to_seconds, seconds_to_ns

PARTS, MORE_PARTS = ("walls.ply", "floors.ply"), ("columns.ply",)  # doors are left out: they stand open
LEAST_MOTION_M = 0.01
PAGE = "the links of the README of HKUST-Aerial-Robotics/SLABIM, or the data set BobH62/SLABIM"


@dataclass(frozen=True)
class SlabimSession:
    """A session of the data set, with all required files present."""

    name: str
    scans: tuple[Path, ...]  # in order
    stamps_ns: tuple[int, ...]
    truth: Trajectory  # T_bim_sensor
    meshes: tuple[Path, ...]

    @staticmethod
    def open(root: Path, name: str) -> "SlabimSession":
        """Opens a session such as `3F_Region1`. Raises UserError for missing or inconsistent files."""
        sessions = root / "sensor_data"
        points = sessions / name / "points"
        if not (points / "data").is_dir():
            there = sorted(p.name for p in sessions.iterdir() if p.is_dir()) if sessions.is_dir() else []
            message = f"there are: {', '.join(there)}" if there else "give the folder with BIM and sensor_data"
            raise UserError(f"{points / 'data'}: no such folder; {message}")
        mesh = root / "BIM" / name.partition("_")[0] / "mesh"
        if missing := [part for part in PARTS if not (mesh / part).is_file()]:
            raise UserError(f"{mesh}: has no {missing[0]}; unpack the data set's BIM there")
        scans = [p for p in (points / "data").iterdir() if p.suffix.lower() in READERS and not p.name.startswith(".")]
        scans.sort(key=lambda p: natural_key(p.name))
        stamps = _stamps(points / "timestamps.txt")
        if len(stamps) != len(scans):
            raise UserError(f"{points / 'timestamps.txt'}: {len(stamps)} stamps for {len(scans)} scans")
        truth = _truth(points / "pose_frame_to_bim.txt")
        meshes = (mesh / part for part in (*PARTS, *MORE_PARTS))
        return SlabimSession(name, tuple(scans), tuple(stamps), truth, tuple(m for m in meshes if m.is_file()))

    def lay_out(self, out: Path) -> None:
        """Writes `scans` (links and times.txt), `a_graph.json`, `truth.tum`, and `sequence.yaml`, a list with it
        for the study of real recordings.

        Existing files are replaced. Raises UserError if the meshes are not of a building.
        """
        graph = read_mesh(*self.meshes).graph
        folder = out / "scans"
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.iterdir():
            if old.is_symlink():
                old.unlink()
        for scan in self.scans:
            os.symlink(scan.resolve(), folder / scan.name)
        write_atomically(folder / "times.txt", "".join(f"{ns_to_seconds(t)}\n" for t in self.stamps_ns))
        self.truth.write_tum(out / "truth.tum")
        graph.save(out / "a_graph.json")
        files = {"bim": "a_graph.json", "scans": "scans", "truth": "truth.tum"}
        lines = "".join(f"  {key}: {(out / file).resolve()}\n" for key, file in files.items())
        write_atomically(out / "sequence.yaml", f"- name: {self.name}\n{lines}")


class Slabim(DataSet):
    """The folder with `BIM` and `sensor_data`; a session is run with the meshes of its storey."""

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
        mesh = self.folder / "BIM" / sequence.partition("_")[0] / "mesh"
        points = self.folder / "sensor_data" / sequence / "points"
        check_whole((mesh / part for part in PARTS), f"unpack BIM.zip again ({PAGE})")
        texts = points / "timestamps.txt", points / "pose_frame_to_bim.txt"
        check_whole((*texts, points / "data"), f"unpack sensor_data/{sequence}.zip again ({PAGE})")
        SlabimSession.open(self.folder, sequence)

    def open(self, sequence: str, work: Path) -> Recording:
        """Lays the session out in `work`, as `python -m data.datasets` does."""
        laid, session = work / f"slabim-{sequence}", SlabimSession.open(self.folder, sequence)
        session.lay_out(laid)
        return Recording(ScanFolder(laid / "scans"), session.truth, laid / "a_graph.json")


def _stamps(path: Path) -> list[int]:
    """Stamps from the last number of each line, seconds or integer nanoseconds."""
    stamps = []
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read; it must hold one stamp per scan") from None
    for number, line in enumerate(lines, 1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if not fields:
            continue
        try:
            whole = fields[-1].isdecimal() and int(fields[-1]) >= 1_000_000 * NS
            stamps.append(int(fields[-1]) if whole else seconds_to_ns(fields[-1]))
        except ValueError as error:
            raise UserError(f"{path}, line {number}: {error}") from None
    return stamps


def _truth(path: Path) -> Trajectory:
    """The poses; an early release has identical ones, since its scans are in the building's frame."""
    truth = Trajectory.read_tum(path)
    if len(truth) > 1 and np.ptp(truth.positions, axis=0).max() < LEAST_MOTION_M:
        raise UserError(f"{path}: all poses are the same; use the later release of the data set, with moving poses")
    return truth
