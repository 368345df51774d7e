"""Which data set a folder holds."""

from pathlib import Path

from data.common.errors import UserError
from evaluation.studies.real.conslam import Conslam
from evaluation.studies.real.data_set import DataSet
from evaluation.studies.real.hilti import Hilti2021, HiltiTrimble2026
from evaluation.studies.real.listed import LISTS, Listed
from evaluation.studies.real.slabim import Slabim

KNOWN: tuple[type[DataSet], ...] = (Listed, Slabim, HiltiTrimble2026, Hilti2021, Conslam)  # in order of recognition


def data_set_in(folder: Path, topic: str | None = None) -> DataSet:
    """The data set in a folder. Raises UserError if there is none."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder; give the one that holds the data set")
    for kind in KNOWN:
        if kind.is_in(folder):
            return kind(folder, topic)
    known = ", ".join(kind.name for kind in KNOWN if kind is not Listed)
    raise UserError(f"{folder}: not the layout of {known}; add {LISTS[0]}, a list of your recordings")
