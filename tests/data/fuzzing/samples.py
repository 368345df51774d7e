"""Small whole files of every format, to be damaged: each function writes them in a folder and returns their bytes."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from bag_files import START, lidar_bag, store, write_bag
from bag_files import imu as imu_message
from g2o_files import drawn_graph
from small_ifc import DOORS, FLOOR, ROOMS, write_small_ifc
from small_ifc import WALLS as WALL_BOXES

from data.imu import ImuSamples, write_imu
from data.scans.writers import SCAN_WRITERS
from matching.self_test import three_rooms, write_small_network
from sgslam.config import Config
from sgslam.config.loading import save_config
from sgslam.mapping import KeyframeClouds
from sgslam.serialization import write_state

POINTS = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32) * 5
TIMES = np.linspace(0, 0.1, len(POINTS), dtype=np.float32)
_ROOMS = [shapely.box(*room) for room in ROOMS.values()]
_DOORS = [shapely.box(x0, y0, x1, y1) for x0, y0, _, x1, y1, _ in DOORS]
_WALLS = shapely.union_all([shapely.box(x0, y0, x1, y1) for x0, y0, _, x1, y1, _ in WALL_BOXES.values()])
_WALLS = shapely.difference(_WALLS, shapely.union_all(_DOORS))
_RINGS = [ring for part in shapely.get_parts(_WALLS) for ring in (part.exterior, *part.interiors)]


def scans(suffix: str, folder: Path) -> list[bytes]:
    """As our writers make them, without and with times, and in the other encodings of the format."""
    from pypcd4 import Encoding, PointCloud

    path, made = folder / f"a{suffix}", []
    for times in (None, TIMES):
        SCAN_WRITERS[suffix[1:]](path, POINTS, times)
        made.append(path.read_bytes())
    rows = np.column_stack([POINTS, TIMES])
    if suffix == ".npy":
        named = np.rec.fromarrays(list(rows.T), names="x,y,z,time")
        for array in (rows.astype(np.float64), np.asfortranarray(POINTS), named, rows.reshape(5, 8, 4)):
            np.save(path, array)
            made.append(path.read_bytes())
    if suffix == ".bin":  # enough for their width to be looked at
        made += [np.tile(rows[:, :width], (9, 1)).tobytes() for width in (3, 4)]
    if suffix == ".pcd":
        made.append(made[0].replace(b"COUNT 1 1 1 1\n", b"").replace(b"TYPE F F F F", b"TYPE f F D F"))
        cloud = PointCloud.from_points([*POINTS.T, np.arange(40)], ("x", "y", "z", "t"), (*[np.float32] * 3, np.uint32))
        for encoding in (Encoding.ASCII, Encoding.BINARY_COMPRESSED):
            cloud.save(path, encoding=encoding)
            made.append(path.read_bytes())
    if suffix == ".ply":
        header, text = made[1].partition(b"end_header\n")[0] + b"end_header\n", io.BytesIO()
        np.savetxt(text, rows, "%.4f")
        for name, values in ((b"ascii", text.getvalue()), (b"binary_big_endian", rows.astype(">f4").tobytes())):
            made.append(header.replace(b"binary_little_endian", name) + values)
    return made


def las(suffix: str, folder: Path) -> list[bytes]:
    """LAS 1.2 and 1.4, by laspy."""
    import laspy

    made = []
    for version in ("1.2", "1.4"):
        data = laspy.LasData(laspy.LasHeader(point_format=1, version=version))
        data.x, data.y, data.z = POINTS.T.astype(float)
        data.gps_time = TIMES
        data.write(folder / f"a{suffix}")
        made.append((folder / f"a{suffix}").read_bytes())
    return made


def e57(folder: Path) -> list[bytes]:
    """Two scans with poses, by pye57."""
    import pye57

    file = pye57.E57(str(folder / "a.e57"), mode="w")
    columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), POINTS.T.astype(float), strict=True))
    for k in range(2):
        file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.array([k, 0.0, 0]))
    file.close()
    return [(folder / "a.e57").read_bytes()]


def bag(kind: str, folder: Path) -> list[bytes]:
    """A bag's file of three scans."""
    path = lidar_bag(folder / ("a.bag" if kind.startswith("ros1") else "bag"), kind, count=3)
    return [p.read_bytes() for p in (path, *path.parent.glob("bag/*")) if p.suffix in (".bag", ".mcap", ".db3")]


def ifc(folder: Path) -> list[bytes]:
    """With and without IfcSpaces."""
    return [write_small_ifc(folder / "a.ifc", spaces=spaces).path.read_bytes() for spaces in (True, False)]


def ifczip(folder: Path) -> list[bytes]:
    made = []
    for raw in ifc(folder):
        with zipfile.ZipFile(packed := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("a.ifc", raw)
        made.append(packed.getvalue())
    return made


def geojson(folder: Path) -> list[bytes]:
    """Rooms with walls and doors, and walls alone as lines."""
    storey = {"storey": "1", "elevation": 3.0, "height": 2.8}
    parts = [*((room, "room") for room in _ROOMS), (_WALLS, "wall"), *((door, "door") for door in _DOORS)]
    rooms = [_feature(shape, type=kind, name=str(k), **storey) for k, (shape, kind) in enumerate(parts)]
    lines = [_feature(shapely.LineString(ring), kind="wall") for ring in _RINGS]
    return [json.dumps({"type": "FeatureCollection", "features": f}).encode() for f in (rooms, lines)]


def _feature(shape: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": properties}


def floor_plan(folder: Path) -> list[bytes]:
    """Our JSON of a floor plan."""
    rooms = [{"name": f"r{k}", "polygon": shapely.geometry.mapping(room)} for k, room in enumerate(_ROOMS)]
    elements = {"wall": [{"polygon": shapely.geometry.mapping(_WALLS)}]}
    return [json.dumps({"name": "fuzz", "unit": "m", "rooms": rooms, "elements": elements}).encode()]


def dxf(folder: Path) -> list[bytes]:
    """Walls as polylines and as a block, by ezdxf, in the short old form and the present one."""
    import ezdxf

    made = []
    for version in ("R12", "R2010"):
        drawing = ezdxf.new(version)
        block = drawing.blocks.new("WALLS")
        for ring in _RINGS:
            points = list(ring.coords)
            drawing.modelspace().add_polyline2d(points, dxfattribs={"layer": "WALL"})
            block.add_line(points[0], points[1], dxfattribs={"layer": "0"})
        drawing.modelspace().add_blockref("WALLS", (0, 0), dxfattribs={"layer": "WALL"})
        drawing.saveas(folder / "a.dxf")
        made.append((folder / "a.dxf").read_bytes())
    return made


def mesh(suffix: str, folder: Path) -> list[bytes]:
    """Walls on a floor."""
    import trimesh

    boxes = [trimesh.creation.box(bounds=np.reshape(box, (2, 3))) for box in (*WALL_BOXES.values(), FLOOR)]
    trimesh.util.concatenate(boxes).export(folder / f"a{suffix}")
    return [(folder / f"a{suffix}").read_bytes()]


def graph(folder: Path) -> list[bytes]:
    return [json.dumps(three_rooms().to_dict()).encode()]


def trajectory(folder: Path) -> list[bytes]:
    return ["".join(f"{1700000000 + k / 10:.9f} 1 2 0.5 0 0 0.6 0.8\n" for k in range(12)).encode()]


def poses(form: str, folder: Path) -> list[bytes]:
    """As KITTI or EuRoC has them."""
    rows = {"kitti": "1 0 0 {k} 0 0 -1 2 0 1 0 0.5\n", "euroc": "170000000{k}000000000,1,2,{k}.5,0.8,0,0,0.6\n"}
    return ["".join(rows[form].format(k=k) for k in range(10)).encode()]


def imu(folder: Path) -> list[bytes]:
    """A file in EuRoC's form."""
    stamps = START + 5_000_000 * np.arange(12)
    samples = ImuSamples(stamps, np.full((12, 3), 0.01), np.tile([0.0, 0.0, 9.8], (12, 1)))
    write_imu(samples, folder / "imu.csv")
    return [(folder / "imu.csv").read_bytes()]


def imu_bag(folder: Path) -> list[bytes]:
    """A bag's file of an IMU's samples."""
    types = store(ros1=True)
    made = [(START + k, imu_message(types, START + k, np.zeros(3), np.array([0.0, 0.0, 9.8]))) for k in range(12)]
    return [write_bag(folder / "a.bag", "ros1", {"/imu": made}).read_bytes()]


def times(folder: Path) -> list[bytes]:
    return ["".join(f"{1700000000 + k / 10:.9f}\n" for k in range(12)).encode()]


def g2o(folder: Path) -> list[bytes]:
    return ["\n".join(drawn_graph().lines).encode()]


def settings(folder: Path) -> list[bytes]:
    return [save_config(Config()).encode(), b"odometry: {voxel_size: 0.4}\nkeyframes:\n  distance: 0.5\n"]


def network(suffix: str, folder: Path) -> list[bytes]:
    """A small one: those that are shipped have more weights than form."""
    write_small_network(folder / f"a{suffix}")
    return [(folder / f"a{suffix}").read_bytes()]


def state(folder: Path) -> list[bytes]:
    write_state(folder / "a.npz", {"run": 1}, {"points": POINTS, "list": [1, 2.5, "x", (1, None)]}, {})
    return [(folder / "a.npz").read_bytes()]


def clouds(folder: Path) -> list[bytes]:
    made = KeyframeClouds(folder / "a.bin")
    for k in range(3):
        made.add(k, POINTS + k)
    return [(folder / "a.bin").read_bytes()]
