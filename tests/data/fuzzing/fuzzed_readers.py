"""Every reader of files from outside, with small whole samples of its format."""

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import plan_files
import scan_files
from bag_files import START, imu, store, write_bag
from g2o_files import drawn_graph
from small_ifc import write_small_ifc
from trimesh import load as load_mesh

from data.generation.buildings import generate_plan
from data.ifc.guard import read_guarded
from data.imu import ImuSamples, read_imu, write_imu
from data.plans import load_bim, read_plans
from data.plans.mesh_plan import read_mesh
from data.scans.formats import read_timed
from data.scans.sources import open_scans
from data.scene_graph import SceneGraph
from data.slam_output.g2o import read_g2o
from data.trajectory.stamps import read_times
from data.trajectory.trajectory import read_poses
from matching.judge import Judge
from sgslam.config import Config
from sgslam.config.loading import load_config, save_config
from sgslam.serialization import read_state, write_state


@dataclass(frozen=True)
class Reader:
    """`samples` makes whole files in a folder, `read` reads one; `share`: how many inputs beside other readers'."""

    name: str
    suffix: str
    samples: Callable[[Path], list[bytes]]
    read: Callable[[Path], object]
    share: float = 1.0
    form: Literal["bytes", "json", "zip"] = "bytes"


def _scans(path: Path) -> object:
    return [len(scan.points) for scan in open_scans(path)]


def _scan_samples(suffix: str, folder: Path) -> list[bytes]:
    return [write(scan_files.points_of(0)) for name, write in scan_files.FILES.items() if name.endswith(suffix)]


def _bag(kind: str, folder: Path) -> list[bytes]:
    made = scan_files.write_scans(f"{kind} of ouster", folder)
    return [p.read_bytes() for p in (made, *folder.glob("drive/*")) if p.suffix in (".bag", ".mcap", ".db3")]


def _plans(start: str, folder: Path) -> list[bytes]:
    return [f(folder, plan_files.hall()).read_bytes() for name, f in plan_files.PLANS.items() if name.startswith(start)]


def _mesh(suffix: str, folder: Path) -> list[bytes]:
    load_mesh(plan_files.PLANS["mesh"](folder, plan_files.hall())).export(folder / f"b{suffix}")
    return [(folder / f"b{suffix}").read_bytes()]


def _ifc(folder: Path) -> list[bytes]:
    return [write_small_ifc(folder / "a.ifc", spaces=spaces).path.read_bytes() for spaces in (True, False)]


def _ifczip(folder: Path) -> list[bytes]:
    with zipfile.ZipFile(packed := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.ifc", _ifc(folder)[0])
    return [packed.getvalue()]


def _imu(folder: Path) -> list[bytes]:
    stamps = START + 5_000_000 * np.arange(12)
    write_imu(ImuSamples(stamps, np.full((12, 3), 0.01), np.tile([0.0, 0.0, 9.8], (12, 1))), folder / "imu.csv")
    return [(folder / "imu.csv").read_bytes()]


def _imu_bag(folder: Path) -> list[bytes]:
    types = store(ros1=True)
    made = [(START + k, imu(types, START + k, np.zeros(3), np.array([0.0, 0.0, 9.8]))) for k in range(12)]
    return [write_bag(folder / "a.bag", "ros1", {"/imu": made}).read_bytes()]


def _lines(form: str, folder: Path) -> list[bytes]:
    return ["".join(form.replace("{k}", str(k)) for k in range(10)).encode()]


def _judge(folder: Path) -> list[bytes]:
    from matching.judge.judge import shapes
    from matching.training.judge import save_judge

    # the one that is shipped has more weights than form
    save_judge(folder / "a", Judge({name: np.zeros(size, np.float32) for name, size in shapes(1, 4).items()}))
    return [(folder / "a").read_bytes()]


def _state(folder: Path) -> list[bytes]:
    write_state(folder / "a.bin", {"run": 1}, {"map": b"points", "tracking": b""})
    return [(folder / "a.bin").read_bytes()]


SETTINGS = (save_config(Config()).encode(), b"odometry: {voxel_size: 0.4}\nkeyframes:\n  distance: 0.5\n")
GRAPH = json.dumps(generate_plan("apartment", 4).graph.to_dict()).encode()


def _all() -> Iterator[Reader]:
    for suffix in (".bin", ".npy", ".pcd", ".ply", ".las", ".laz"):
        yield Reader(f"scans {suffix}", suffix, partial(_scan_samples, suffix), read_timed)
    for kind, suffix in (("ros1", ".bag"), ("ros1-lz4", ".bag"), ("mcap", ".mcap"), ("sqlite3", ".db3")):
        yield Reader(f"bag {kind}", suffix, partial(_bag, kind), _scans, 0.5)
    yield Reader("IMU", ".csv", _imu, read_imu)
    yield Reader("IMU, bag", ".bag", _imu_bag, read_imu, 0.5)
    yield Reader("IFC", ".ifc", _ifc, partial(read_guarded, seconds=10), 0.05)
    yield Reader("IFC, packed", ".ifczip", _ifczip, partial(read_guarded, seconds=10), 0.02, "zip")
    yield Reader("GeoJSON", ".geojson", partial(_plans, "geojson"), load_bim, 0.2, "json")
    yield Reader("DXF", ".dxf", partial(_plans, "dxf"), load_bim, 0.1)
    yield Reader("floor plan", ".json", partial(_plans, "floor"), lambda path: list(read_plans(path)), 0.5, "json")
    for suffix in (".stl", ".obj"):
        yield Reader(f"mesh {suffix}", suffix, partial(_mesh, suffix), read_mesh, 0.05)
    yield Reader("scene graph", ".json", lambda _: [GRAPH], SceneGraph.load, form="json")
    for form, suffix, line in (
        ("TUM", ".tum", "170000000{k}.5 1 {k} 0.5 0 0 0.6 0.8\n"),
        ("KITTI", ".txt", "1 0 0 {k} 0 0 -1 2 0 1 0 0.5\n"),
    ):
        yield Reader(f"poses, {form}", suffix, partial(_lines, line), read_poses, 0.7)
    yield Reader("times", ".txt", partial(_lines, "170000000{k}.5\n"), read_times)
    yield Reader(
        "g2o", ".g2o", lambda _: ["\n".join(drawn_graph().lines).encode()], lambda p: read_g2o(p).scene_graph()
    )
    yield Reader("settings", ".yaml", lambda _: [*SETTINGS], lambda path: load_config(path, []), 0.3)
    yield Reader("judge", ".safetensors", _judge, Judge.load, 0.5)
    yield Reader("state", ".bin", _state, read_state, 0.5)


READERS = tuple(_all())
