"""SLABIM: sessions of a hand-held sensor in a university building, with the BIM of each storey (ICRA 2025)."""

from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.datasets import SlabimSession
from data.scans import ScanFolder
from evaluation.drives.buildings import locked, plan_graph
from evaluation.studies.real.data_set import DataSet, Recording
from evaluation.studies.real.whole_files import check_whole

PAGE = "the links of the README of HKUST-Aerial-Robotics/SLABIM, or the data set BobH62/SLABIM"
ARCHIVES = {  # bytes, as that data set lists them on its page: exact for the BIM, else to three digits
    "BIM.zip": 96_380_034,
    "sensor_data/1F_Region1.zip": 40.6e9, "sensor_data/1F_Region2.zip": 38.9e9, "sensor_data/1F_Region3.zip": 31.8e9,
    "sensor_data/3F_Region1.zip": 21.2e9, "sensor_data/3F_Region2.zip": 12.7e9, "sensor_data/3F_Region3.zip": 12.6e9,
    "sensor_data/4F_Region1.zip": 22.1e9, "sensor_data/4F_Region2.zip": 14.4e9, "sensor_data/4F_Region3.zip": 5.87e9,
    "sensor_data/5F_Region1.zip": 16.3e9, "sensor_data/5F_Region2.zip": 6.47e9,
}  # fmt: skip
_ROUNDING = 0.005  # of a size, by which three digits may be above it


class Slabim(DataSet):
    """The folder with `BIM` and `sensor_data`; a session is run with the meshes of its storey."""

    name = "SLABIM"

    @staticmethod
    def is_in(folder: Path) -> bool:
        """By `sensor_data`, unpacked or not, or the BIM."""
        return any((folder / part).exists() for part in ("sensor_data", "BIM", "BIM.zip"))

    def sequences(self) -> list[str]:
        """The unpacked sessions."""
        points = sorted((self.folder / "sensor_data").glob("*/points"))
        if not points:
            wanted = self._archive("sensor_data/3F_Region1.zip", *sorted(self._found("sensor_data/*.zip")))
            raise UserError(f"{self.folder / 'sensor_data'}: no session with its points in it; {wanted}")
        return [path.parent.name for path in points]

    def check(self, sequence: str) -> None:
        """The meshes, the scans, their stamps and their poses."""
        mesh = self.folder / "BIM" / sequence.partition("_")[0] / "mesh"
        check_whole((mesh / part for part in ("walls.ply", "floors.ply")), self._archive("BIM.zip"))
        points, again = self.folder / "sensor_data" / sequence / "points", f"sensor_data/{sequence}.zip"
        scans = sorted((points / "data").glob("*.pcd"))
        if not scans:
            raise UserError(f"{points / 'data'}: no .pcd files in it; {self._archive(again)}")
        texts = (points / "timestamps.txt", points / "pose_frame_to_bim.txt")
        check_whole((*texts, *scans), self._archive(again))
        SlabimSession.open(self.folder, sequence)

    def open(self, sequence: str, work: Path) -> Recording:
        """Lays the session out in `work`, as `python -m data.datasets` does."""
        laid = work / f"slabim-{sequence}"
        with locked(laid):
            session = SlabimSession.open(self.folder, sequence)
            session.lay_out(laid)
        return Recording(ScanFolder(laid / "scans"), plan_graph(laid / "a_graph.json"), session.truth, np.zeros(3))

    def _found(self, pattern: str) -> list[str]:
        return [path.relative_to(self.folder).as_posix() for path in self.folder.glob(pattern)]

    def _archive(self, first: str, *others: str) -> str:
        """What to do to get the content of an archive: of the first that is there, else of `first`."""
        name = next((name for name in (first, *others) if (self.folder / name).is_file()), first)
        path = self.folder / name
        if not path.is_file():
            return f"download {name} ({PAGE}) and unpack it here"
        size, stated = path.stat().st_size, ARCHIVES.get(name)
        if stated is None or size >= (1 - _ROUNDING) * stated:
            return f"unpack {name} here"
        return f"{name} has {size:,} of {stated:,.0f} bytes: complete its download, then unpack it here"
