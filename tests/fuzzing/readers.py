"""Every reader of files from outside, with its samples, its damage, and how often it is tried."""

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.scans.formats import read_timed
from data.scans.reading_errors import UnreadableScanError
from fuzzing import samples
from fuzzing.mutations import mutate, mutate_e57, mutate_json, mutate_zip

REFUSED = (UserError, UnreadableScanError)


@dataclass(frozen=True)
class Reader:
    """`samples` makes whole files in a folder, `read` reads one; `share`: how many inputs beside other readers'."""

    name: str
    suffix: str
    samples: Callable[[Path], list[bytes]]
    read: Callable[[Path], object]
    mutate: Callable[[list[bytes], random.Random], bytes] = mutate
    share: float = 1.0


def _building(path: Path) -> object:
    from data.plans import load_bim

    return load_bim(path, path.parent / "cache")


def _ifc(path: Path) -> object:
    from data.ifc.guard import read_guarded

    return read_guarded(path, seconds=10)


def _scans(path: Path) -> object:
    from data.scans.sources import open_scans

    return sum(len(scan.points) for scan in open_scans(path))


def _tum(path: Path) -> object:
    from data.trajectory import Trajectory

    return Trajectory.read_tum(path)


def _times(path: Path) -> object:
    from data.trajectory.stamps import read_times

    return read_times(path)


def _g2o(path: Path) -> object:
    from data.scene_graph.g2o import read_g2o

    return read_g2o(path).scene_graph()


def _config(path: Path) -> object:
    from sgslam.config.loading import load_config

    return load_config(path, [])


def _graph(path: Path) -> object:
    from data.scene_graph import SceneGraph

    return SceneGraph.load(path)


def _plans(path: Path) -> object:
    from data.plans import read_plans

    return list(read_plans(path, on_skip=lambda line: None))


def _mesh(path: Path) -> object:
    from data.plans.mesh_plan import read_mesh

    return read_mesh(path)


def _weights(path: Path) -> object:
    from matching.learned.torch_weights import load_network

    return load_network(path)


def _learned(path: Path) -> object:
    from matching.learned.weights_file import load_learned

    return load_learned(path)


def _state(path: Path) -> object:
    from sgslam.serialization import read_state

    return read_state(path, {})


def _clouds(path: Path) -> object:
    from sgslam.mapping import KeyframeClouds

    clouds = KeyframeClouds.open(path)
    return [clouds[k] for k in clouds]


@cache
def _matcher() -> Any:
    from matching import Matcher

    return Matcher.load()


@cache
def _plan() -> Any:
    return samples.a_graph()


def _match(path: Path) -> object:
    """A graph as it comes from a file, to the networks, as the map and as the plan."""
    graph = _graph(path)
    return _matcher().match(graph, _plan()), _matcher().match(_plan(), graph)


def _g2o_lines(folder: Path) -> list[bytes]:
    eye = " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
    planes = ((1, 0, 0, 2), (-1, 0, 0, 2), (0, 1, 0, 3), (0, -1, 0, 3))
    lines = [f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1" for k in range(3)]
    lines += [f"VERTEX_PLANE {10 + k} {' '.join(map(str, p))}" for k, p in enumerate(planes)]
    lines += ["VERTEX_ROOM 20 0 0 0", "FIX 2", "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1" + eye]
    lines += [f"EDGE_SE3_PLANE 0 {10 + k} {' '.join(map(str, p))} 1 0 0 1 0 1" for k, p in enumerate(planes)]
    return ["\n".join([*lines, "EDGE_ROOM_4PLANES 20 10 11 12 13", "EDGE_2PLANES 10 11", ""]).encode()]


def _config_sample(folder: Path) -> list[bytes]:
    from sgslam.config import Config
    from sgslam.config.loading import save_config

    return [save_config(Config()).encode(), b"odometry: {voxel_size: 0.4}\nkeyframes:\n  distance: 0.5\n"]


def _graph_sample(folder: Path) -> list[bytes]:
    return [json.dumps(samples.a_graph().to_dict()).encode()]


def _weights_sample(suffix: str, folder: Path) -> list[bytes]:
    """A small network: those that are shipped have more weights than form."""
    from matching.self_test import write_small_network

    write_small_network(folder / f"a{suffix}")
    return [(folder / f"a{suffix}").read_bytes()]


def _state_sample(folder: Path) -> list[bytes]:
    from sgslam.serialization import write_state

    write_state(folder / "a.npz", {"run": 1}, {"points": samples.POINTS, "list": [1, 2.5, "x", (1, None)]}, {})
    return [(folder / "a.npz").read_bytes()]


def _clouds_sample(folder: Path) -> list[bytes]:
    from sgslam.mapping import KeyframeClouds

    clouds = KeyframeClouds(folder / "a.bin")
    for k in range(3):
        clouds.add(k, samples.POINTS + k)
    return [(folder / "a.bin").read_bytes()]


def _rows(count: int) -> Callable[[Path], list[bytes]]:
    row = " 1 2 0.5 0 0 0.6 0.8" if count == 8 else ""
    return lambda folder: ["".join(f"{1700000000 + k / 10:.9f}{row}\n" for k in range(12)).encode()]


READERS = (
    *(Reader(f"scans {s}", s, partial(samples.scan, s), read_timed, share=1.5)
      for s in (".bin", ".npy", ".pcd", ".ply")),
    *(Reader(f"scans {s}", s, partial(samples.las, s), read_timed) for s in (".las", ".laz")),
    Reader("scans .e57", ".e57", samples.e57, _scans, mutate_e57, 0.3),
    *(Reader(f"bag {kind}", suffix, partial(samples.bag, kind), _scans, share=0.5)
      for kind, suffix in (("ros1", ".bag"), ("ros1-lz4", ".bag"), ("mcap", ".mcap"), ("sqlite3", ".db3"))),
    Reader("IFC", ".ifc", samples.ifc, _ifc, share=0.05),
    Reader("IFC, packed", ".ifczip", lambda folder: samples.ifc(folder, packed=True), _ifc, mutate_zip(mutate), 0.02),
    Reader("GeoJSON", ".geojson", lambda folder: samples.geojson(), _building, mutate_json, 0.2),
    Reader("DXF", ".dxf", samples.dxf, _building, share=0.1),
    Reader("floor plan", ".json", lambda folder: samples.floor_plan(), _plans, mutate_json, 0.5),
    Reader("mesh .stl", ".stl", lambda folder: samples.mesh(folder, ".stl"), _mesh, share=0.05),
    Reader("mesh .obj", ".obj", lambda folder: samples.mesh(folder, ".obj"), _mesh, share=0.05),
    Reader("scene graph", ".json", _graph_sample, _graph, mutate_json),
    Reader("trajectory", ".tum", _rows(8), _tum),
    Reader("times", ".txt", _rows(1), _times),
    Reader("g2o", ".g2o", _g2o_lines, _g2o),
    Reader("settings", ".yaml", _config_sample, _config, share=0.3),
    Reader("network", ".npz", partial(_weights_sample, ".npz"), _learned, mutate_zip(mutate), 0.5),
    Reader("network of torch", ".pt", partial(_weights_sample, ".pt"), _weights, mutate_zip(mutate), 0.2),
    Reader("network's input", ".json", _graph_sample, _match, mutate_json, 0.02),
    Reader("state", ".npz", _state_sample, _state, mutate_zip(mutate), 0.5),
    Reader("keyframe clouds", ".bin", _clouds_sample, _clouds),
)  # fmt: skip
