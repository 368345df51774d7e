"""ConSLAM: recordings of a construction site, month by month (ECCV workshops 2022), with the IFC model and the poses
that were published later as "ConSLAM BIM and GT Poses"."""

from pathlib import Path

from data.bags import is_bag
from data.common.errors import UserError
from data.common.files import natural_key
from data.datasets.data_set import DataSet, Recording, check_whole
from data.scans.sources import open_scans
from data.trajectory import Trajectory

RECORDINGS = "the recordings of ConSLAM (README of mac137/ConSLAM)"
MODEL = "'ConSLAM BIM and GT Poses' (mediaTUM 1743877)"


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
