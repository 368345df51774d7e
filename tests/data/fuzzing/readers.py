"""Every reader of files from outside, with its samples, its damage, and how often it is tried."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from data.ifc.guard import read_guarded
from data.imu import read_imu
from data.plans import load_bim, read_plans
from data.plans.mesh_plan import read_mesh
from data.scans.formats import read_timed
from data.scans.sources import open_scans
from data.scene_graph import SceneGraph
from data.scene_graph.g2o import read_g2o
from data.streams import McapPipe
from data.trajectory import Trajectory
from data.trajectory.readers import read_poses
from data.trajectory.stamps import read_times
from fuzzing import samples
from fuzzing.mutations import Mutate, mutate, mutate_e57, mutate_json, mutate_zip
from matching import Matcher
from matching.learned.weights_file import load_learned
from matching.self_test import three_rooms
from sgslam.config.loading import load_config
from sgslam.mapping import KeyframeClouds
from sgslam.serialization import read_state


@dataclass(frozen=True)
class Reader:
    """`samples` makes whole files in a folder, `read` reads one; `share`: how many inputs beside other readers'."""

    name: str
    suffix: str
    samples: Callable[[Path], list[bytes]]
    read: Callable[[Path], object]
    mutate: Mutate = mutate
    share: float = 1.0


def _scans(path: Path) -> object:
    return [len(scan.points) for scan in open_scans(path)]


def _piped(path: Path) -> object:
    with path.open("rb") as file:
        return [len(arrival.scan.points) for arrival in McapPipe(file)]


def _clouds(path: Path) -> object:
    clouds = KeyframeClouds.open(path)
    return [clouds[k] for k in clouds]


def _network_of_torch(path: Path) -> object:
    from matching.learned.torch_weights import load_network  # PyTorch is slow to import

    return load_network(path)


_matcher = cache(Matcher.load)


def _match(path: Path) -> object:
    """A graph as it comes from a file, to the networks, as the map and as the plan."""
    graph = SceneGraph.load(path)
    return _matcher().match(graph, three_rooms()), _matcher().match(three_rooms(), graph)


READERS = (
    *(Reader(f"scans {s}", s, partial(samples.scans, s), read_timed, share=1.5)
      for s in (".bin", ".npy", ".pcd", ".ply")),
    *(Reader(f"scans {s}", s, partial(samples.las, s), read_timed) for s in (".las", ".laz")),
    Reader("scans .e57", ".e57", samples.e57, _scans, mutate_e57, 0.3),
    *(Reader(f"bag {kind}", suffix, partial(samples.bag, kind), _scans, share=0.5)
      for kind, suffix in (("ros1", ".bag"), ("ros1-lz4", ".bag"), ("mcap", ".mcap"), ("sqlite3", ".db3"))),
    Reader("MCAP through a pipe", ".mcap", partial(samples.bag, "mcap"), _piped, share=0.5),
    Reader("IMU", ".csv", samples.imu, read_imu),
    Reader("IMU, bag", ".bag", samples.imu_bag, read_imu, share=0.5),
    Reader("IFC", ".ifc", samples.ifc, partial(read_guarded, seconds=10), share=0.05),
    Reader("IFC, packed", ".ifczip", samples.ifczip, partial(read_guarded, seconds=10), mutate_zip, 0.02),
    Reader("GeoJSON", ".geojson", samples.geojson, load_bim, mutate_json, 0.2),
    Reader("DXF", ".dxf", samples.dxf, load_bim, share=0.1),
    Reader("floor plan", ".json", samples.floor_plan, lambda path: list(read_plans(path)), mutate_json, 0.5),
    *(Reader(f"mesh {s}", s, partial(samples.mesh, s), read_mesh, share=0.05) for s in (".stl", ".obj")),
    Reader("scene graph", ".json", samples.graph, SceneGraph.load, mutate_json),
    Reader("trajectory", ".tum", samples.trajectory, Trajectory.read_tum),
    *(Reader(f"poses, {form}", ".txt", partial(samples.poses, form), read_poses, share=0.5)
      for form in ("kitti", "euroc")),
    Reader("times", ".txt", samples.times, read_times),
    Reader("g2o", ".g2o", samples.g2o, lambda path: read_g2o(path).scene_graph()),
    Reader("settings", ".yaml", samples.settings, lambda path: load_config(path, []), share=0.3),
    Reader("network", ".npz", partial(samples.network, ".npz"), load_learned, mutate_zip, 0.5),
    Reader("network of torch", ".pt", partial(samples.network, ".pt"), _network_of_torch, mutate_zip, 0.2),
    Reader("network's input", ".json", samples.graph, _match, mutate_json, 0.02),
    Reader("state", ".npz", samples.state, lambda path: read_state(path, {}), mutate_zip, 0.5),
    Reader("keyframe clouds", ".bin", samples.clouds, _clouds),
)  # fmt: skip
