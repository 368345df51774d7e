"""One way to read floor plans of every source: a stream of `Plan`s, each an A-graph in metres."""

import hashlib
import json
import logging
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from data.common.errors import UserError
from data.plans.bim import IFC_SUFFIXES, load_bim
from data.plans.polygons import Plan
from data.plans.published_plans import Buildings, read_json_plan, read_msd

_log = logging.getLogger(__name__)
MAX_MEMBER = 50_000_000  # bytes: no plan is larger
Split = Literal["train", "validation", "test"]

SHARES: Mapping[Split, float] = MappingProxyType({"train": 0.7, "validation": 0.15, "test": 0.15})


def read_plans(path: Path | str, merge_collinear: bool = True) -> Iterator[Plan]:
    """Reads plans one by one, in the order of their names (a table's in its own order).

    `path` is a folder of plan JSON files or one of them (see `published_plans`), a `.tar.gz` of such files, Modified
    Swiss Dwellings' `.csv` (its apartments), an `.ifc` or `.ifczip`,
    or an A-graph as `.json`. Of many plans those that cannot be used are left out, each with one
    line in the log; a single one raises. `merge_collinear=False`: see `scene_graph_of`.

    Raises UserError where the path is none of these or where none of the plans can be used.
    """
    path = Path(path)
    name = path.name.lower()
    if path.is_dir():
        files = sorted(p for p in path.iterdir() if p.suffix.lower() == ".json")
        if not files:
            raise UserError(f"{path}: no plans (.json) in this folder")
        yield from _usable(((str(f), f.read_bytes()) for f in files), path, merge_collinear)
    elif not path.is_file():
        raise UserError(f"{path}: no such file or folder; give plans (.json, .csv, .tar.gz, .ifc) or a folder of them")
    elif name.endswith((".tar.gz", ".tgz", ".tar")):
        yield from _usable(_members(path), path, merge_collinear)
    elif name.endswith(IFC_SUFFIXES):
        yield Plan(path.stem, path.stem, load_bim(path).graph)
    elif name.endswith(".csv"):
        yield from read_msd(path, merge_collinear)
    elif name.endswith(".json"):
        yield _one(path, merge_collinear)
    else:
        raise UserError(f"{path}: not a plan; give plans (.json, .csv, .tar.gz, .ifc) or a folder of them")


def _one(path: Path, merge_collinear: bool) -> Plan:
    raw = path.read_bytes()
    try:
        value = json.loads(raw)
    except ValueError:
        raise UserError(f"{path}: not JSON; give a floor plan or an A-graph") from None
    if isinstance(value, dict) and "schema_version" in value:
        return Plan(path.stem, path.stem, load_bim(path).graph)
    return read_json_plan(raw, str(path), merge_collinear)


def _usable(texts: Iterable[tuple[str, bytes]], path: Path, merge_collinear: bool) -> Iterator[Plan]:
    buildings, skipped, used = Buildings(), 0, 0
    for where, text in texts:
        try:
            plan = read_json_plan(text, where, merge_collinear)
        except UserError as error:
            skipped += 1
            _log.warning(f"skipped {error}")
            continue
        used += 1
        yield replace(plan, building=buildings.of(plan))
    if not used:
        raise UserError(f"{path}: none of its {skipped} plans can be used")


def _members(path: Path) -> Iterator[tuple[str, bytes]]:
    """The JSON files of a tar archive, in its order; nothing is extracted to disk, links are not followed."""
    try:
        with tarfile.open(path) as archive:
            for member in archive:
                if member.isreg() and member.name.endswith(".json") and member.size <= MAX_MEMBER:
                    file = archive.extractfile(member)
                    assert file is not None  # it is a regular file
                    yield member.name, file.read()
    except (tarfile.TarError, EOFError, OSError) as error:
        raise UserError(f"{path}: not a readable tar archive ({error})") from None


def split_of(building: str) -> Split:
    """The split of all plans of a building, by a hash of its name: the same on every machine."""
    digest = hashlib.sha256(f"0:{building}".encode()).digest()
    at = int.from_bytes(digest[:8], "big") / 2**64
    for split, share in SHARES.items():
        if at < share:
            return split
        at -= share
    return "test"
