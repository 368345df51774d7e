"""The building's plan, an IFC file, a drawing, GeoJSON or an A-graph, as a scene graph in the BIM frame."""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from data.common.errors import UserError
from data.common.files import read_json, user_cache, write_json
from data.ifc.guard import read_guarded
from data.scene_graph import SceneGraph

EXTRACTOR_VERSION = 9  # to be raised whenever the A-graph of the same file changes
IFC_SUFFIXES = (".ifc", ".ifczip")
PLANS = "an IFC file (.ifc, .ifczip), a drawing (.dxf), GeoJSON (.geojson), or an A-graph (.json)"


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
        from data.plans.dxf import read_dxf

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
    value = read_json(path, PLANS)
    known = value if isinstance(value, dict) else {}
    if path.suffix.lower() == ".geojson" or known.get("type") in ("FeatureCollection", "Feature"):
        from data.plans.geojson import plan_of

        return Bim(*plan_of(value, str(path)))
    if "rooms" in known and "schema_version" not in known:
        from data.plans.published_plans import read_json_plan

        return Bim(read_json_plan(path.read_bytes(), str(path)).graph)
    return Bim(_with_walls(SceneGraph.load(path), path))


def _with_walls(graph: SceneGraph, path: Path) -> SceneGraph:
    if not graph.wall_surfaces:
        raise UserError(f"{path}: has no wall surfaces; give an A-graph with walls")
    return graph


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
