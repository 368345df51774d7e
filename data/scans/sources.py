"""Opens scans in any form: a folder of scans, a bag, an E57 file, a sequence of evalio's."""

from pathlib import Path

from data.common.errors import UserError
from data.scans.evalio import EvalioScans, is_evalio
from data.scans.folder import ScanFolder
from data.scans.formats import READERS
from data.scans.point_times import Stamped
from data.scans.scan import ScanSource


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
    if is_bag(path) and not (path.is_dir() and _has_scans(path)):
        return BagScans(path, topic)
    if topic is not None:
        raise UserError(f"--topic {topic}: {path} is not a bag and has no topics")
    if is_evalio(path):
        return EvalioScans(path)
    if path.suffix.lower() == ".e57":
        from data.scans.e57 import E57Scans

        return E57Scans(path)
    return ScanFolder(path)


def _has_scans(folder: Path) -> bool:
    return any(p.suffix.lower() in READERS for p in folder.iterdir() if not p.name.startswith("."))
