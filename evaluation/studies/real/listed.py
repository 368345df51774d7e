"""Recordings of one's own: a folder with a YAML list of them."""

from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.scans.sources import open_scans
from data.trajectory import Trajectory
from evaluation.drives.buildings import plan_graph
from evaluation.drives.sequences import SequenceSpec, read_specs
from evaluation.studies.real.data_set import DataSet, Recording, parts_of
from evaluation.studies.real.whole_files import check_whole

LISTS = ("sequences.yaml", "sequence.yaml")  # the second one is what `python -m data.datasets` writes


class Listed(DataSet):
    """A folder with `sequences.yaml`, of the form that `read_specs` takes; relative paths are from that folder."""

    name = "own recordings"

    @staticmethod
    def is_in(folder: Path) -> bool:
        """By the list."""
        return any((folder / name).is_file() for name in LISTS)

    def sequences(self) -> list[str]:
        """All of the list."""
        return list(self._specs())

    def check(self, sequence: str) -> None:
        """Plan, scans and truth."""
        bim, scans, truth = self._paths(sequence)
        advice = f"correct the paths of '{sequence}' in {self._list()}, or copy the file again"
        check_whole([bim, truth], advice)
        if scans.is_dir() and not parts_of(scans):
            raise UserError(f"{scans}: no scans in it; {advice}")
        check_whole(parts_of(scans), advice)

    def open(self, sequence: str, work: Path) -> Recording:
        """Scans of every form that `sgslam.run` takes as a file or a folder."""
        bim, scans, truth = self._paths(sequence)
        return Recording(open_scans(scans, self.topic), plan_graph(bim), Trajectory.read_tum(truth), np.zeros(3))

    def _list(self) -> Path:
        return next(self.folder / name for name in LISTS if (self.folder / name).is_file())

    def _specs(self) -> dict[str, SequenceSpec]:
        specs = read_specs(self._list())
        if simulated := [spec.name for spec in specs if spec.simulated]:
            raise UserError(f"{self._list()}: '{simulated[0]}' has no scans; add its scans and truth, or leave it out")
        return {spec.name: spec for spec in specs}

    def _paths(self, sequence: str) -> tuple[Path, Path, Path]:
        """Plan, scans and truth."""
        spec = self._specs()[sequence]
        assert spec.scans is not None and spec.truth is not None
        return self.folder / spec.bim, self.folder / spec.scans, self.folder / spec.truth
