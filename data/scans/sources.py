"""Opens scans in any form: a folder of scans, a bag, an E57 file, a sequence of evalio's."""

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import natural_key
from data.scans.evalio import EvalioScans, is_evalio
from data.scans.formats import READERS, is_scan, read_timed
from data.scans.point_times import Stamped, check_interval, unusable
from data.scans.scan import WORST_SHARE_SKIPPED, Scan, ScanSource, finished
from data.trajectory.stamps import NOTE_INDICES, SCAN_PERIOD_NS, read_times, stamps_from_names, times_of

_INSIDE = (*READERS, ".bag", ".mcap", ".db3")  # what a folder may hold to be given instead of the one above it
_PACKETS = (".pcap", ".pcapng", ".lvx", ".lvx2")  # of the drivers of spinning sensors and of Livox
_NAMED = 5  # folders in a message


class ScanFolder(ScanSource):
    """The scans of a folder in natural order of their names. Also has `files`; `stamps_ns` is always known."""

    stamps_ns: NDArray[np.int64]

    def __init__(self, path: Path | str) -> None:
        """Lists the files and determines their stamps; reads no scan.

        Raises UserError for a folder that is missing, empty or of mixed formats, and for stamps that do not fit the
        number of scans, are in a wrong unit, or of which more than a fifth repeat or go backwards.
        """
        super().__init__()
        self.path = Path(path)
        files = _list_scans(self.path)
        self.files, stamps, self.note = _order_and_stamps(self.path, files)
        self.stamps_ns = np.array(stamps, dtype=np.int64)
        kitti = self.path.resolve()
        if kitti.name == "velodyne" and all((kitti.parent / name).is_file() for name in ("calib.txt", "times.txt")):
            self.stamped = "middle"  # when the LiDAR faces forward and the cameras are triggered
        check_interval(stamps, str(self.path))
        if len(bad := unusable(stamps)) > WORST_SHARE_SKIPPED * len(stamps):
            first, why = next(iter(bad.items()))
            raise UserError(
                f"{self.path}: {len(bad)} of {len(stamps)} scans have wrong stamps, more than a fifth; the first is "
                f"{self.files[first].name}: {why}"
            )

    def __len__(self) -> int:
        """The number of scans in the folder, readable or not."""
        return len(self.files)

    def _name(self, index: int) -> tuple[Path, str]:
        return self.files[index], self.files[index].name

    def _read(self, index: int) -> Scan:
        stamp_ns = int(self.stamps_ns[index])
        points, times = read_timed(self.files[index])
        return finished(index, stamp_ns, points, times, self.files[index], stamped=self.stamped)


def _list_scans(path: Path) -> list[Path]:
    if path.suffix.lower() in _PACKETS:
        raise UserError(f"{path}: raw packets are not read; let the sensor's driver write a bag of point clouds")
    if not path.is_dir():
        what = "is a file" if path.exists() else "does not exist"
        raise UserError(f"{path}: {what}; give a folder of scans ({', '.join(READERS)})")
    files = [f for f in path.iterdir() if is_scan(f) and f.is_file()]
    if not files:
        raise UserError(f"{path}: no scans in it; {_where_else(path)}")
    formats = Counter(f.suffix.lower() for f in files)
    if len(formats) > 1:
        found = ", ".join(f"{count} {suffix}" for suffix, count in sorted(formats.items()))
        raise UserError(f"{path}: scans of mixed formats ({found}); leave one format in the folder")
    return sorted(files, key=lambda f: natural_key(f.name))


def _where_else(path: Path) -> str:
    """What to give instead of a folder without scans: the folders in it, or in these, that hold some."""
    files = (f for pattern in ("*/*", "*/*/*") for f in path.glob(pattern) if f.suffix.lower() in _INSIDE)
    shown = {f.parent for f in files if not any(part.startswith(".") for part in f.relative_to(path).parts)}
    if not shown:
        return f"give a folder of {', '.join(READERS)} files"
    found = sorted(map(str, shown), key=natural_key)
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    what = "that folder" if len(found) == 1 else "one of these"
    return f"there are some in {', '.join(found[:_NAMED])}{more}; give {what}"


def _order_and_stamps(path: Path, files: list[Path]) -> tuple[list[Path], list[int], str | None]:
    """The files in order, their stamps (ns), and a note on the stamps for the user."""
    if times := times_of(path):
        stamps = read_times(times)
        if len(stamps) != len(files):
            raise UserError(f"{times}: {len(stamps)} stamps for the {len(files)} scans in {path}; give a line for each")
        return files, stamps, None
    named = stamps_from_names(files)
    if named is None:
        return files, [i * SCAN_PERIOD_NS for i in range(len(files))], NOTE_INDICES
    # seconds may have been printed with any number of places, and then 1.25 comes before 1.5, not after
    order = sorted(range(len(files)), key=named.__getitem__)
    return [files[i] for i in order], [named[i] for i in order], None


def open_scans(path: Path | str, topic: str | None = None, stamped: Stamped = "auto") -> ScanSource:
    """Opens the scans of a folder, a bag, an E57 file, or `evalio:DATASET/SEQUENCE`; in a bag, those of one `topic`,
    which is chosen automatically if None. `stamped` is the instant of a scan that its stamp names; `auto` is what the
    format fixes, else the start.

    Raises UserError if there are none, and if a `topic` is given for anything but a bag.
    """
    source = _opened(path, topic)
    if stamped != "auto":
        source.stamped = stamped
    elif source.stamped != "start":
        source.note = f"stamps are taken as those of each scan's {source.stamped}, as in KITTI; --stamp says otherwise"
    return source


def _opened(path: Path | str, topic: str | None) -> ScanSource:
    from data.bags import is_bag
    from data.scans.bags import BagScans

    path = Path(path)
    if is_bag(path) and not (path.is_dir() and any(map(is_scan, path.iterdir()))):
        return BagScans(path, topic)
    if topic is not None:
        raise UserError(f"--topic {topic}: {path} is not a bag and has no topics")
    if is_evalio(path):
        return EvalioScans(path)
    if path.suffix.lower() == ".e57":
        from data.scans.surveyed import E57Scans

        return E57Scans(path)
    return ScanFolder(path)
