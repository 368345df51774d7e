"""Public data sets, and recordings of one's own: what is in a folder, and how it is run."""

from pathlib import Path

from data.common.errors import UserError
from data.datasets.data_set import LISTS, DataSet, Listed, Recording
from data.datasets.published import Conslam, Hilti2021, Slabim

KNOWN: tuple[type[DataSet], ...] = (Listed, Slabim, Hilti2021, Conslam)  # in order of recognition
__all__ = ["KNOWN", "DataSet", "Recording", "data_set_in"]


def data_set_in(folder: Path, topic: str | None = None) -> DataSet:
    """The data set in a folder. Raises UserError if there is none."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder; give the one that holds the data set")
    for kind in KNOWN:
        if any(next(folder.glob(sign), None) for sign in kind.signs):
            return kind(folder, topic)
    known = ", ".join(kind.name for kind in KNOWN if kind is not Listed)
    raise UserError(f"{folder}: not the layout of {known}; add {LISTS[0]}, a list of your recordings")
