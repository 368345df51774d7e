"""ConSLAM: recordings of a construction site, month by month (ECCV workshops 2022), with the IFC model and the poses
that were published later as "ConSLAM BIM and GT Poses"."""

from pathlib import Path

import numpy as np

from data.bags import is_bag
from data.common.errors import UserError
from data.common.files import natural_key
from data.scans.sources import open_scans
from data.trajectory import Trajectory
from evaluation.drives.buildings import plan_graph
from evaluation.studies.real.data_set import DataSet, Recording, parts_of
from evaluation.studies.real.whole_files import check_whole

RECORDINGS = "the recordings of ConSLAM (README of mac137/ConSLAM)"
MODEL = "'ConSLAM BIM and GT Poses' (mediaTUM 1743877)"


class Conslam(DataSet):
    """A folder with one IFC file, and for each sequence its scans (`sequence_2.bag`, or a folder `sequence_2` of scans)
    and its poses (`sequence_2.txt`, TUM format). Both downloads are to be put together so."""

    name = "ConSLAM"

    @staticmethod
    def is_in(folder: Path) -> bool:
        """By a sequence, or by the folder's name."""
        return bool(_recordings(folder)) or "conslam" in folder.resolve().name.lower()

    def sequences(self) -> list[str]:
        """The recordings with poses; all, if none has any."""
        found = list(_recordings(self.folder))
        if not found:
            raise UserError(f"{self.folder}: no sequence_2.bag or the like in it; download {RECORDINGS}")
        return [name for name in found if self._truth(name).exists()] or found

    def check(self, sequence: str) -> None:
        """The model, the scans and the poses."""
        check_whole([self._model(), self._truth(sequence)], f"download it from {MODEL}")
        scans = _recordings(self.folder)[sequence]
        if not parts_of(scans):
            raise UserError(f"{scans}: no scans in it; download {RECORDINGS}")
        check_whole(parts_of(scans), f"download it again from {RECORDINGS}")

    def open(self, sequence: str, work: Path) -> Recording:
        """A bag is read as it is."""
        scans = open_scans(_recordings(self.folder)[sequence], self.topic)
        return Recording(scans, plan_graph(self._model()), Trajectory.read_tum(self._truth(sequence)), np.zeros(3))

    def _model(self) -> Path:
        models = sorted(self.folder.glob("*.ifc"))
        if len(models) != 1:
            raise UserError(f"{self.folder}: {len(models)} IFC files in it; put the one of {MODEL} there")
        return models[0]

    def _truth(self, sequence: str) -> Path:
        return self.folder / f"{sequence}.txt"


def _recordings(folder: Path) -> dict[str, Path]:
    """Bags and folders named `sequence...`, by name."""
    found = (path for path in folder.glob("[sS]equence*") if path.is_dir() or is_bag(path))
    return {path.name.removesuffix(".bag"): path for path in sorted(found, key=lambda path: natural_key(path.name))}
