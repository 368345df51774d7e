"""Small valid files of every supported format, generated for the fuzzing to damage."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from data.ifc.writer import IfcWriter, Prism
from data.scans.writers import SCAN_WRITERS
from data.scene_graph import SceneGraph

POINTS = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32) * 5
_ROOMS = (shapely.box(0.3, 0.3, 4.0, 3.7), shapely.box(4.1, 0.3, 7.7, 3.7))
_WALLS = shapely.difference(shapely.box(0, 0, 8, 4), shapely.union_all([*_ROOMS, shapely.box(3.9, 1, 4.2, 1.9)]))


def scan(suffix: str, folder: Path) -> list[bytes]:
    """A scan each as our writers make it, and the same in text where the format has one."""
    path = folder / f"a{suffix}"
    SCAN_WRITERS[suffix[1:]](path, POINTS, None)
    rows = "".join(f"{x:.4f} {y:.4f} {z:.4f} {k}\n" for k, (x, y, z) in enumerate(POINTS.tolist()))
    ply = f"ply\nformat ascii 1.0\nelement vertex {len(POINTS)}\nproperty float x\nproperty float y\nproperty float z\n"
    pcd = "VERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 40\nHEIGHT 1\n"
    more = {
        ".ply": ply + "property uint t\nend_header\n" + rows,
        ".pcd": pcd + "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA ascii\n" + rows,
    }
    made = [path.read_bytes(), *([more[suffix].encode()] if suffix in more else [])]
    if suffix == ".pcd":
        from pypcd4 import Encoding, PointCloud

        PointCloud.from_xyz_points(POINTS).save(path, encoding=Encoding.BINARY_COMPRESSED)
        made.append(path.read_bytes())
    return made


def las(suffix: str, folder: Path) -> list[bytes]:
    """LAS 1.2 and 1.4, by laspy."""
    import laspy

    made = []
    for version in ("1.2", "1.4"):
        data = laspy.LasData(laspy.LasHeader(point_format=1, version=version))
        data.x, data.y, data.z = POINTS.T.astype(float)
        data.gps_time = np.linspace(0, 0.1, len(POINTS))
        data.write(folder / f"a{suffix}")
        made.append((folder / f"a{suffix}").read_bytes())
    return made


def e57(folder: Path) -> list[bytes]:
    """Two scans with poses, by pye57."""
    import pye57

    path = folder / "a.e57"
    file = pye57.E57(str(path), mode="w")
    for k in range(2):
        columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), POINTS.T.astype(float), strict=True))
        file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.array([k, 0.0, 0]))
    file.close()
    return [path.read_bytes()]


def bag(kind: str, folder: Path) -> list[bytes]:
    """A bag's file of three scans, by rosbags: ros1, ros1-lz4, mcap or sqlite3."""
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Ros2Writer
    from rosbags.typesys import Stores, get_typestore

    ros1 = kind.startswith("ros1")
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    path = folder / ("a.bag" if ros1 else "bag")
    writer: Any
    if ros1:
        writer = Ros1Writer(path)
        if kind.endswith("lz4"):
            writer.set_compression(Ros1Writer.CompressionFormat.LZ4)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
    name = "sensor_msgs/msg/PointCloud2"
    with writer:
        connection = writer.add_connection("/points", name, typestore=types)
        for k in range(3):
            message = _cloud(types, k * 100_000_000, ros1)
            raw = types.serialize_ros1(message, name) if ros1 else types.serialize_cdr(message, name)
            writer.write(connection, k * 100_000_000, raw)
    if ros1:
        return [path.read_bytes()]
    return [next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3")).read_bytes()]


def _cloud(types: Any, stamp_ns: int, ros1: bool) -> Any:
    of = types.types
    header = {"stamp": of["builtin_interfaces/msg/Time"](1, stamp_ns), "frame_id": "", **({"seq": 0} if ros1 else {})}
    fields = [of["sensor_msgs/msg/PointField"](axis, 4 * k, 7, 1) for k, axis in enumerate("xyz")]
    return of["sensor_msgs/msg/PointCloud2"](
        header=of["std_msgs/msg/Header"](**header), height=1, width=len(POINTS), fields=fields, is_bigendian=False,
        point_step=12, row_step=12 * len(POINTS), data=np.frombuffer(POINTS.tobytes(), np.uint8), is_dense=True,
    )  # fmt: skip


def ifc(folder: Path, packed: bool = False) -> list[bytes]:
    """Two rooms with their walls, with and without IfcSpaces."""
    made = []
    for spaces in (True, False):
        writer = IfcWriter("fuzz", {"ground": 0.0})
        for part in shapely.get_parts(shapely.constrained_delaunay_triangles(_WALLS)):
            writer.element("IfcWall", "w", "ground", [Prism(tuple(part.exterior.coords)[:-1], 0.0, 2.6)])
        for k, room in enumerate(_ROOMS if spaces else ()):
            writer.space(f"r{k}", "ground", Prism(tuple(room.exterior.coords)[:-1], 0.0, 2.6), f"room {k}")
        path = folder / "a.ifc"
        writer.save(path)
        raw = path.read_bytes()
        if packed:
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("a.ifc", raw)
            raw = buffer.getvalue()
        made.append(raw)
    return made


def geojson() -> list[bytes]:
    """Rooms with walls and a door, and walls alone as lines."""
    properties = {"storey": "1", "elevation": 3.0, "height": 2.8}
    rooms = [_feature(room, {"type": "room", "name": str(k), **properties}) for k, room in enumerate(_ROOMS)]
    rooms.append(_feature(_WALLS, {"type": "wall", **properties}))
    rooms.append(_feature(shapely.Point(4.05, 1.4), {"type": "door", **properties}))
    rings = [r for p in shapely.get_parts(_WALLS) for r in (p.exterior, *p.interiors)]
    lines = [_feature(shapely.LineString(ring.coords), {"kind": "wall"}) for ring in rings]
    return [json.dumps({"type": "FeatureCollection", "features": f}).encode() for f in (rooms, lines)]


def _feature(shape: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": properties}


def floor_plan() -> list[bytes]:
    """Our JSON of a floor plan."""
    rooms = [{"name": f"r{k}", "polygon": shapely.geometry.mapping(room)} for k, room in enumerate(_ROOMS)]
    elements = {"wall": [{"polygon": shapely.geometry.mapping(_WALLS)}]}
    return [json.dumps({"name": "fuzz", "unit": "m", "rooms": rooms, "elements": elements}).encode()]


def a_graph() -> SceneGraph:
    """Of the same rooms."""
    from data.plans.geojson import plan_of

    return plan_of(json.loads(geojson()[0]), "sample")[0]


def dxf(folder: Path) -> list[bytes]:
    """Walls as polylines and as a block, by ezdxf, in the short old form and the present one."""
    import ezdxf

    made = []
    for version in ("R12", "R2010"):
        drawing = ezdxf.new(version)
        block = drawing.blocks.new("WALLS")
        for polygon in shapely.get_parts(_WALLS):
            for ring in (polygon.exterior, *polygon.interiors):
                points = list(ring.coords)
                drawing.modelspace().add_polyline2d(points, dxfattribs={"layer": "WALL"})
                block.add_line(points[0], points[1], dxfattribs={"layer": "0"})
        drawing.modelspace().add_blockref("WALLS", (0, 0), dxfattribs={"layer": "WALL"})
        drawing.saveas(folder / "a.dxf")
        made.append((folder / "a.dxf").read_bytes())
    return made


def mesh(folder: Path, suffix: str) -> list[bytes]:
    """A room's walls on a floor."""
    import trimesh

    boxes = [((0, -2.1, 1.2), (6, 0.2, 2.6)), ((0, 2.1, 1.2), (6, 0.2, 2.6)), ((-3.1, 0, 1.2), (0.2, 4.4, 2.6)),
             ((3.1, 0, 1.2), (0.2, 4.4, 2.6)), ((0, 0, -0.1), (7, 5, 0.2))]  # fmt: skip
    parts = [trimesh.creation.box(extents=e, transform=trimesh.transformations.translation_matrix(c)) for c, e in boxes]
    trimesh.util.concatenate(parts).export(folder / f"a{suffix}")
    return [(folder / f"a{suffix}").read_bytes()]
