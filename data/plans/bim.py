"""The building's plan, an IFC file, a drawing, GeoJSON or an A-graph, as a scene graph in the BIM frame; floor plans of
every source as a stream of `Plan`s, each an A-graph in metres."""

import hashlib
import json
import logging
import os
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from data.common.errors import UserError, refusing
from data.common.files import read_json, user_cache, write_json
from data.ifc.guard import read_guarded
from data.plans.dxf import read_dxf
from data.plans.geojson import plan_of
from data.plans.polygons import Plan
from data.plans.published_plans import Buildings, read_json_plan
from data.scene_graph import SceneGraph

EXTRACTOR_VERSION = 10  # to be raised whenever the A-graph of the same file changes
IFC_SUFFIXES = (".ifc", ".ifczip")
PLANS = "an IFC file (.ifc, .ifczip), a drawing (.dxf), GeoJSON (.geojson), or an A-graph (.json)"
SETS = "plans (.json, .tar.gz, .ifc) or a folder of them"
MAX_MEMBER = 50_000_000  # bytes: no plan is larger
_log = logging.getLogger(__name__)
Split = Literal["train", "validation", "test"]
SHARES: Mapping[Split, float] = {"train": 0.7, "validation": 0.15, "test": 0.15}


@dataclass(frozen=True)
class Bim:
    """The A-graph, notices for the user, one line each, and the file it was read from, None if it was not."""

    graph: SceneGraph
    notices: tuple[str, ...] = ()
    path: Path | None = field(default=None, compare=False)


def load_bim(path: Path | str, cache_dir: Path | str | None = None, layers: Sequence[str] = ()) -> Bim:
    """Reads a plan: `.ifc` or `.ifczip`; `.dxf` (`layers` are the names of the wall layers); `.geojson`; or `.json`
    with an A-graph, GeoJSON or a floor plan (`data.plans.published_plans`).

    The result for an IFC file is cached in `cache_dir` (default: $SGSLAM_CACHE_DIR, else sgslam in the user's cache
    directory) under the file's SHA-256. Raises UserError for a file that is missing, unreadable, of another kind, or
    has no walls.
    """
    path = Path(path)
    return replace(_read(path, cache_dir, layers), path=path.absolute())


def _read(path: Path, cache_dir: Path | str | None, layers: Sequence[str]) -> Bim:
    suffix = path.suffix.lower()
    if not path.is_file():
        raise UserError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; give {PLANS}")
    if suffix == ".dxf":
        return Bim(*read_dxf(path, layers))
    if layers:
        raise UserError(f"--layer {layers[0]}: {path} is not a DXF drawing and has no layers")
    if suffix in (".json", ".geojson"):
        return _of_json(path)
    if suffix not in IFC_SUFFIXES:
        raise UserError(f"{path}: not a building; give {PLANS}")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    entry = (Path(cache_dir) if cache_dir else plan_cache()) / f"a_graph-{digest}-{EXTRACTOR_VERSION}.json"
    bim = _cached(entry)
    if bim is None:
        made = read_guarded(path)
        bim = Bim(SceneGraph.from_dict(made["graph"]), tuple(made["notices"]))
        _keep(entry, bim)
    return bim


def _of_json(path: Path) -> Bim:
    known = _object(path)
    if path.suffix.lower() == ".geojson" or known.get("type") in ("FeatureCollection", "Feature"):
        return Bim(*plan_of(known, str(path)))
    if "rooms" in known and "schema_version" not in known:
        return Bim(read_json_plan(path.read_bytes(), str(path)).graph)
    graph = SceneGraph.load(path)
    if not graph.wall_surfaces:
        raise UserError(f"{path}: has no wall surfaces; give an A-graph with walls")
    return Bim(graph)


def _object(path: Path) -> dict[str, Any]:
    value = read_json(path, PLANS)
    return value if isinstance(value, dict) else {}


def plan_cache() -> Path:
    """The folder of cached A-graphs: $SGSLAM_CACHE_DIR, else `sgslam` in the user's cache directory."""
    return Path(os.environ.get("SGSLAM_CACHE_DIR") or user_cache())


def _cached(entry: Path) -> Bim | None:
    """The cached result; None if there is none that can be read."""
    try:
        kept = json.loads(entry.read_text())
        return Bim(SceneGraph.from_dict(kept["graph"]), tuple(map(str, kept["notices"])))
    except (OSError, ValueError, KeyError, TypeError, UserError):
        return None


def _keep(entry: Path, bim: Bim) -> None:
    """Writes the cache; a failure only costs time at the next run."""
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        write_json(entry, {"graph": bim.graph.to_dict(), "notices": list(bim.notices)})
    except OSError:
        return


def read_plans(path: Path | str, merge_collinear: bool = True) -> Iterator[Plan]:
    """Reads plans one by one, in the order of their names.

    `path` is a folder of plan JSON files or one of them (see `published_plans`), a `.tar.gz` of such files, an `.ifc`
    or `.ifczip`, or an A-graph as `.json`. Of many plans those that cannot be used are left out, each with one line in
    the log; a single one raises. `merge_collinear=False`: see `scene_graph_of`.

    Raises UserError where the path is none of these or where none of the plans can be used.
    """
    path = Path(path)
    name = path.name.lower()
    if not path.exists():
        raise UserError(f"{path}: no such file or folder; give {SETS}")
    if path.is_dir() or name.endswith((".tar.gz", ".tgz", ".tar")):
        yield from _usable(path, merge_collinear)
    elif name.endswith(IFC_SUFFIXES) or (name.endswith(".json") and "schema_version" in _object(path)):
        yield Plan(path.stem, path.stem, load_bim(path).graph)
    elif name.endswith(".json"):
        yield read_json_plan(path.read_bytes(), str(path), merge_collinear)
    else:
        raise UserError(f"{path}: not a plan; give {SETS}")


def _usable(path: Path, merge_collinear: bool) -> Iterator[Plan]:
    buildings, skipped, used = Buildings(), 0, 0
    for where, text in _folder(path) if path.is_dir() else _members(path):
        try:
            plan = read_json_plan(text, where, merge_collinear)
        except UserError as error:
            skipped += 1
            _log.warning(f"skipped {error}")
            continue
        used += 1
        yield replace(plan, building=buildings.of(plan))
    if not used:
        raise UserError(f"{path}: none of its {skipped} plans (.json) can be used")


def _folder(path: Path) -> Iterator[tuple[str, bytes]]:
    return ((str(file), file.read_bytes()) for file in sorted(path.glob("*.json")))


def _members(path: Path) -> Iterator[tuple[str, bytes]]:
    """The JSON files of a tar archive, in its order; nothing is extracted to disk, links are not followed."""
    with refusing(f"{path}: not a readable tar archive"), tarfile.open(path) as archive:
        for member in archive:
            if member.isreg() and member.name.endswith(".json") and member.size <= MAX_MEMBER:
                yield member.name, archive.extractfile(member).read()  # type: ignore[union-attr]


def split_of(building: str) -> Split:
    """The split of all plans of a building, by a hash of its name: the same on every machine."""
    digest = hashlib.sha256(f"0:{building}".encode()).digest()
    at = int.from_bytes(digest[:8], "big") / 2**64
    for split, share in SHARES.items():
        if at < share:
            return split
        at -= share
    return "test"
