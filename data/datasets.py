"""Public data sets that have a plan, and recordings of one's own: what is in a folder, and how it is run.

SLABIM: scans of a university building with its BIM. ConSLAM: recordings of a construction site, month by month (ECCV
workshops 2022), with the IFC model and the poses that were published later as "ConSLAM BIM and GT Poses".
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from data.bags import is_bag
from data.common.errors import UserError, refusing
from data.common.files import natural_key, parsed_lines
from data.plans.mesh_plan import read_mesh
from data.scans.scan import ScanSource
from data.scans.sources import open_scans
from data.trajectory import Trajectory
from data.trajectory.stamps import NS, seconds_to_ns

LIST = "sequences.yaml"
OWN = "own recordings"
SLABIM = "the links of the README of HKUST-Aerial-Robotics/SLABIM, or the data set BobH62/SLABIM"
CONSLAM = "the recordings of ConSLAM (README of mac137/ConSLAM), and 'ConSLAM BIM and GT Poses' (mediaTUM 1743877)"


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording that is ready to run, with the poses T_bim_sensor; `plan` is the building's file or mesh, and
    `storey` the one on which it begins, None where that is not stated."""

    scans: ScanSource
    truth: Trajectory
    plan: Path
    storey: str | None


class Entry(BaseModel):
    """A recording in a list; relative paths are from the list's folder.

    `bim` is the building's file or mesh, or a folder with `walls.ply`, `floors.ply` and maybe `columns.ply`; `scans` a
    folder or a file; `truth` has the poses of the sensor in the building's frame (TUM format); `storey` is the one on
    which the recording begins, if it is stated; `times` has the stamps of a folder's scans, if they are not where they
    are looked for.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: Path
    scans: Path
    truth: Path
    storey: str | None = None
    times: Path | None = None


@dataclass(frozen=True)
class DataSet:
    """A data set in a folder: its recordings by name; `advice` says what to do where files are missing."""

    name: str
    folder: Path
    entries: dict[str, Entry]
    advice: str
    topic: str | None = None

    def building(self, sequence: str) -> str:
        """The building in which it was recorded."""
        return str(self.entries[sequence].bim.relative_to(self.folder)) if self.name == OWN else self.name

    def check(self, sequence: str) -> None:
        """Raises UserError, with the advice, where a file of a recording is missing or empty, or has no scans."""
        entry = self.entries[sequence]
        for path in (*_parts(entry.bim), entry.truth):
            if not path.is_file() or not path.stat().st_size:
                raise UserError(f"{path}: is missing or empty; {self.advice}")
        self._scans(entry)

    def open(self, sequence: str, work: Path) -> Recording:
        """Opens a recording; a plan that is made of meshes goes to `work`. Raises UserError."""
        entry, truth = self.entries[sequence], Trajectory.read_tum(self.entries[sequence].truth)
        if len(truth) > 1 and not truth.length:  # an early release of SLABIM has the scans in the building's frame
            raise UserError(f"{entry.truth}: all poses are the same; use a later release of the data set")
        plan = entry.bim
        if plan.is_dir():
            work.mkdir(parents=True, exist_ok=True)
            plan = work / f"{sequence}.json"
            read_mesh(*_parts(entry.bim)).graph.save(plan)
        return Recording(self._scans(entry), truth, plan, entry.storey)

    def _scans(self, entry: Entry) -> ScanSource:
        source = open_scans(entry.scans, self.topic)
        if entry.times is not None:
            stamps = parsed_lines(entry.times, "one stamp per scan", _stamp)
            if len(stamps) != len(source):
                raise UserError(f"{entry.times}: {len(stamps)} stamps for {len(source)} scans")
            source.stamps_ns, source.note = np.array(stamps, np.int64), None
        return source


def _parts(bim: Path) -> list[Path]:
    """The meshes of a folder; doors are left out: they stand open."""
    columns = [bim / "columns.ply"] if (bim / "columns.ply").is_file() else []
    return [bim] if bim.suffix else [bim / "walls.ply", bim / "floors.ply", *columns]


def _stamp(text: str) -> int:
    """The last number of a line, seconds or whole nanoseconds."""
    last = text.replace(",", " ").split()[-1]
    return int(last) if last.isdecimal() and int(last) >= 1_000_000 * NS else seconds_to_ns(last)


def _listed(folder: Path) -> list[Entry]:
    path = folder / LIST
    with refusing(f"{path}: cannot read this file", "give a YAML list"):
        listed = yaml.safe_load(path.read_text())
    try:
        entries = TypeAdapter(list[Entry]).validate_python(listed)
    except ValidationError as error:
        where, what = error.errors()[0]["loc"], error.errors()[0]["msg"]
        raise UserError(f"{path}: {'.'.join(map(str, where)) or 'list'}: {what}") from None
    paths = ("bim", "scans", "truth", "times")
    return [e.model_copy(update={p: folder / own for p in paths if (own := getattr(e, p))}) for e in entries]


def _slabim(folder: Path) -> list[Entry]:
    """The sessions, such as `3F_Region1`; each is run with its storey's meshes."""
    entries = []
    for points in sorted((folder / "sensor_data").glob("*/points")):
        name, truth, times = points.parent.name, points / "pose_frame_to_bim.txt", points / "timestamps.txt"
        bim = folder / "BIM" / name.partition("_")[0] / "mesh"
        entries.append(Entry(name=name, bim=bim, scans=points / "data", truth=truth, times=times))
    return entries


def _conslam(folder: Path) -> list[Entry]:
    """One IFC file, and for each sequence its scans (`sequence_2.bag`, or a folder `sequence_2` of scans) and its poses
    (`sequence_2.txt`, TUM format)."""
    bim = next(iter(sorted(folder.glob("*.ifc"))), folder / "model.ifc")
    found = [path for path in folder.glob("[sS]equence_*") if path.is_dir() or is_bag(path)]
    named = {p.name.removesuffix(".bag"): p for p in sorted(found, key=lambda path: natural_key(path.name))}
    entries = [Entry(name=n, bim=bim, scans=path, truth=folder / f"{n}.txt") for n, path in named.items()]
    return [entry for entry in entries if entry.truth.is_file()] or entries


KNOWN: dict[str, tuple[str, Callable[[Path], list[Entry]], str]] = {  # a pattern of its files, reader, advice
    OWN: (LIST, _listed, f"correct the paths in {LIST}, or copy the file again"),
    "SLABIM": ("sensor_data", _slabim, f"unpack BIM.zip and a session, such as 3F_Region1.zip, again ({SLABIM})"),
    "ConSLAM": ("[sS]equence_*", _conslam, f"download it again: {CONSLAM}"),
}


def data_set_in(folder: Path, topic: str | None = None) -> DataSet:
    """The data set in a folder; `topic` is that of the scans in a bag. Raises UserError where there is none, or none of
    its recordings."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder; give the one that holds the data set")
    name = next((name for name, (sign, *_) in KNOWN.items() if any(folder.glob(sign))), None)
    if name is None:
        raise UserError(f"{folder}: not the layout of {' or '.join(KNOWN)}; add {LIST}, a list of your recordings")
    _, read, advice = KNOWN[name]
    entries = read(folder)
    if not entries or len({entry.name for entry in entries}) != len(entries):
        raise UserError(f"{folder}: no recordings, each with a name of its own; {advice}")
    return DataSet(name, folder, {entry.name: entry for entry in entries}, advice, topic)
