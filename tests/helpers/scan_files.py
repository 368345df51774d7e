"""The same scans in every form in which scans are read: folders of files, bags, E57."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from bag_files import NS, START, cloud, livox, store, write_bag
from numpy.typing import NDArray

COUNT = 60  # points of a scan, of which two are no returns
GOOD = np.r_[0:5, 6:17, 18:COUNT]
SECONDS = np.linspace(0.0, 0.09, COUNT)
_NS = (SECONDS * 1e9).astype(np.uint32)


def points_of(k: int) -> NDArray[np.float32]:
    """(COUNT, 3) of scan `k`; one is NaN and one zero."""
    points = np.random.default_rng(k).normal(size=(COUNT, 3)).astype(np.float32) * 5
    points[5], points[17] = np.nan, 0.0
    return points


def records(points: NDArray[np.float32]) -> NDArray[Any]:
    """With a ring of two bytes and times in nanoseconds."""
    rows = np.zeros(len(points), [*((axis, "<f4") for axis in "xyz"), ("ring", "<u2"), ("t", "<u4")])
    rows["x"], rows["y"], rows["z"], rows["t"] = *points.T, _NS[: len(points)]
    return rows


def _text(rows: NDArray[Any]) -> bytes:
    return "".join(" ".join(map(str, row)) + "\n" for row in rows.tolist()).encode()


def ply(rows: NDArray[Any], form: str) -> bytes:
    """The records as PLY."""
    kinds = {"f": "float", "u2": "ushort", "u4": "uint"}
    header = f"ply\nformat {form} 1.0\ncomment made here\nelement vertex {len(rows)}\n"
    for name, kind in rows.dtype.descr:
        header += f"property {kinds.get(kind[1:]) or kinds[kind[1]]} {name}\n"
    swapped = rows.astype(rows.dtype.newbyteorder(">" if "big" in form else "<"))
    return f"{header}end_header\n".encode() + (_text(rows) if form == "ascii" else swapped.tobytes())


def pcd(rows: NDArray[Any], form: str) -> bytes:
    """The records as PCD; compressed by another library."""
    if form == "binary_compressed":
        from pypcd4 import Encoding, PointCloud

        names = rows.dtype.names or ()
        made = PointCloud.from_points([rows[n] for n in names], names, [rows.dtype[n].type for n in names])
        made.save(packed := io.BytesIO(), encoding=Encoding.BINARY_COMPRESSED)
        return packed.getvalue()
    kinds = [kind for _, kind in rows.dtype.descr]
    header = f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(rows.dtype.names or ())}\n"
    header += f"SIZE {' '.join(k[2:] for k in kinds)}\nTYPE {' '.join(k[1].upper() for k in kinds)}\n"
    header += f"COUNT{' 1' * len(kinds)}\nWIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
    header += f"POINTS {len(rows)}\nDATA {form}\n"
    return header.encode() + (_text(rows) if form == "ascii" else rows.tobytes())


def _ouster_pcd(points: NDArray[np.float32]) -> bytes:
    """As Ouster's driver and PCL save it: three kinds of padding, one of them of no bytes; 48 bytes a point."""
    header = (
        "FIELDS x y z _ intensity t reflectivity ring _ noise _ range _\nSIZE 4 4 4 1 4 4 2 1 1 2 1 4 1\n"
        "TYPE F F F U F U U U U U U U U\nCOUNT 1 1 1 4 1 1 1 1 0 1 0 1 15\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA binary\n"
    )
    rows = np.zeros((len(points), 12), "<f4")
    rows[:, :3], rows[:, 5] = points, _NS.view("<f4")
    return header.encode() + rows.tobytes()


def npy(array: NDArray[Any]) -> bytes:
    """The array as a file."""
    np.save(buffer := io.BytesIO(), array)
    return buffer.getvalue()


def las(points: NDArray[np.float32], version: str = "1.2", packed: bool = False, extra: bool = False) -> bytes:
    """By laspy; `extra`: the times stand in an extra dimension."""
    import laspy

    header = laspy.LasHeader(point_format=0 if extra else 1, version=version)
    header.scales, header.offsets = np.full(3, 1e-5), np.zeros(3)
    if extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name="Scalar_GpsTime", type=np.float64))
    data = laspy.LasData(header)
    data.x, data.y, data.z = np.nan_to_num(points).T
    data["Scalar_GpsTime" if extra else "gps_time"] = SECONDS + (0.0 if extra else 345_678.0)
    data.write(buffer := io.BytesIO(), do_compress=packed)
    return buffer.getvalue()


def _kitti(points: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.c_[points, np.full(len(points), 0.5, np.float32)].astype("<f4")


FILES: dict[str, Callable[[NDArray[np.float32]], bytes]] = {  # the last word is the suffix
    "kitti.bin": lambda p: _kitti(p).tobytes(),
    "single.npy": npy,
    "organised.npy": lambda p: npy(_kitti(p).reshape(6, 10, 4)),
    "named.npy": lambda p: npy(records(p)),
    "ascii.ply": lambda p: ply(records(p), "ascii"),
    "little.ply": lambda p: ply(records(p), "binary_little_endian"),
    "big.ply": lambda p: ply(records(p), "binary_big_endian"),
    "ascii.pcd": lambda p: pcd(records(p), "ascii"),
    "binary.pcd": lambda p: pcd(records(p), "binary"),
    "compressed.pcd": lambda p: pcd(records(p), "binary_compressed"),
    "ouster.pcd": _ouster_pcd,
    "1.2.las": las,
    "packed.LAZ": lambda p: las(p, packed=True),
    "extra.laz": lambda p: las(p, "1.4", packed=True, extra=True),
}
UNTIMED = ("kitti.bin", "single.npy", "organised.npy")
E57 = ("cartesian.e57", "spherical.e57")
BAGS = ("ros1", "ros1-lz4", "sqlite3", "sqlite3-zstd", "mcap")
LAYOUTS: dict[str, dict[str, Any]] = {  # of the drivers' messages
    "ouster": {"time": ("t", _NS)},
    "velodyne": {"time": ("time", SECONDS.astype(np.float32)), "ring": True},
    "hesai": {"time": ("timestamp", START * 1e-9 + SECONDS), "padding": 1},
    "ouster organised": {"time": ("t", _NS), "height": 4, "row_padding": 7},
    "livox cloud": {"time": ("timestamp", START + SECONDS * 1e9), "padding": 0},
    "big endian": {"time": ("offset_time", _NS), "order": ">", "height": 2},
    "livox": {},
}


def stamp_of(k: int) -> int:
    """Nanoseconds, of scan `k`."""
    return START + k * NS // 10


def write_scans(form: str, folder: Path, count: int = 3) -> Path:
    """What is to be opened: scans 0 to `count` in a form of FILES or E57, or as `KIND of LAYOUT` in a bag."""
    if form in FILES:
        for k in range(count):
            (folder / f"{k}.{form.rpartition('.')[2]}").write_bytes(FILES[form](points_of(k)))
        (folder / "times.txt").write_text("".join(f"{stamp_of(k) / NS:.1f}\n" for k in range(count)))
        return folder
    if form in E57:
        return write_e57(folder / "scans.e57", form.partition(".")[0], [0.0, 1.5, 3.0][:count])
    kind, _, layout = form.partition(" of ")
    types, messages = store(kind.startswith("ros1")), []
    for k in range(count):
        if layout == "livox":
            message = livox(types, points_of(k), _NS, stamp_of(k))
        else:
            own = dict(LAYOUTS[layout])
            if own["time"][0] == "timestamp":  # by the clock of the stamps
                own["time"] = ("timestamp", own["time"][1] + k * (1e8 if own["time"][1][0] > 1e12 else 0.1))
            message = cloud(types, points_of(k), stamp_of(k), **own)
        messages.append((stamp_of(k) + 5_000_000, message))
    path = folder / ("drive.bag" if kind.startswith("ros1") else "drive")
    return write_bag(path, kind, {"/points": messages})


def write_e57(path: Path, system: str, along: list[float]) -> Path:
    """Scans with times, and with poses that have a translation along x and no rotation, by libE57 itself."""
    import pye57

    lib, file = pye57.libe57, pye57.E57(str(path), mode="w")
    image = file.image_file
    for k, x in enumerate(along):
        points = np.nan_to_num(points_of(k).astype(float))
        columns = {f"cartesian{axis}": np.ascontiguousarray(points[:, i]) for i, axis in enumerate("XYZ")}
        if system == "spherical":
            reach = np.linalg.norm(points, axis=1)
            height = np.divide(points[:, 2], reach, out=np.zeros(COUNT), where=reach > 0)
            angles = np.arctan2(points[:, 1], points[:, 0]), np.arcsin(height)
            columns = {"sphericalRange": reach, "sphericalAzimuth": angles[0], "sphericalElevation": angles[1]}
        columns |= {f"{system}InvalidState": (np.arange(COUNT) == 5).astype(float), "timeStamp": SECONDS.copy()}
        node, pose, at, kinds = (lib.StructureNode(image) for _ in range(4))
        for axis, value in {"x": x, "y": 0.0, "z": 0.0}.items():
            at.set(axis, lib.FloatNode(image, value))
        node.set("pose", pose)
        pose.set("translation", at)
        buffers = lib.VectorSourceDestBuffer()
        for name, values in columns.items():
            kinds.set(name, lib.FloatNode(image, 0.0, lib.E57_DOUBLE, -1e9, 1e9))
            buffers.append(lib.SourceDestBuffer(image, name, values, COUNT, True, True))
        packed = lib.CompressedVectorNode(image, kinds, lib.VectorNode(image, True))
        node.set("points", packed)
        file.data3d.append(node)
        packed.writer(buffers).write(COUNT)
    file.close()
    return path
