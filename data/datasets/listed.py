"""Recordings of one's own: a folder with a YAML list of them."""

from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from data.common.errors import UserError
from data.datasets.data_set import DataSet, Recording, check_whole
from data.scans.sources import open_scans
from data.trajectory import Trajectory

LISTS = ("sequences.yaml", "sequence.yaml")  # the second one is what `python -m data.datasets` writes


class Entry(BaseModel):
    """An entry of the list; relative paths are from its folder.

    `bim` is the building's file or mesh, `scans` a folder or a file, `truth` has the poses of the sensor in the
    building's frame (TUM format); `storey` is the one on which the recording begins, if it is stated.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: Path
    scans: Path
    truth: Path
    storey: str | None = None


class Listed(DataSet):
    """A folder with `sequences.yaml`, whose entries are those of `Entry`."""

    name = "own recordings"
    signs = LISTS

    def sequences(self) -> list[str]:
        return list(self._entries())

    def check(self, sequence: str) -> None:
        entry = self._entries()[sequence]
        advice = f"correct the paths of '{sequence}' in {self._list()}, or copy the file again"
        check_whole([self.folder / path for path in (entry.bim, entry.truth, entry.scans)], advice)

    def open(self, sequence: str, work: Path) -> Recording:
        """Scans of every form that `sgslam.run` takes as a file or a folder."""
        entry = self._entries()[sequence]
        scans, truth = open_scans(self.folder / entry.scans, self.topic), self.folder / entry.truth
        return Recording(scans, Trajectory.read_tum(truth), self.folder / entry.bim, entry.storey)

    def building(self, sequence: str) -> str:
        return str(self._entries()[sequence].bim)

    def _list(self) -> Path:
        return next(self.folder / name for name in LISTS if (self.folder / name).is_file())

    def _entries(self) -> dict[str, Entry]:
        """The entries by name. Raises UserError for missing, unknown or repeated ones."""
        path = self._list()
        try:
            found = TypeAdapter(list[Entry]).validate_python(yaml.safe_load(path.read_text()))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise UserError(f"{path}: cannot read this file ({type(error).__name__}); give a YAML list") from None
        except ValidationError as error:
            where, what = error.errors()[0]["loc"], error.errors()[0]["msg"]
            raise UserError(f"{path}: {'.'.join(map(str, where)) or 'list'}: {what}") from None
        entries = {entry.name: entry for entry in found}
        if not entries or len(entries) != len(found):
            raise UserError(f"{path}: must list sequences, each with a name of its own")
        return entries
