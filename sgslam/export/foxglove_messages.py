"""Foxglove's messages (`foxglove_schemas`) as JSON values, from numpy arrays in metres.

Points are relative to an `origin` (3,), which is the position of what they belong to: drawing is in single precision,
and sites lie kilometres from zero.
"""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.geometry.poses import poses_to_xyzquat
from sgslam.export.foxglove_schemas import FLOAT32, PRIMITIVES
from sgslam.viewer.shapes import Mesh

Floats = NDArray[np.float64]
Message = dict[str, Any]
Colour = tuple[float, float, float, float]  # red, green, blue, opacity, from 0 to 1
_NS = 1_000_000_000
_LINE_PX, _LABEL_M = 2.0, 0.4


def time_of(stamp_ns: int) -> Message:
    """A stamp, not before 1970."""
    return {"sec": stamp_ns // _NS, "nsec": stamp_ns % _NS}


def pose_message(stamp_ns: int, frame: str, T_frame_sensor: Floats) -> Message:
    """`foxglove.PoseInFrame` of (4, 4) T_frame_sensor."""
    return {"timestamp": time_of(stamp_ns), "frame_id": frame, "pose": _pose(T_frame_sensor)}


def transform_message(stamp_ns: int, parent: str, child: str, T_parent_child: Floats) -> Message:
    """`foxglove.FrameTransform` of (4, 4) T_parent_child."""
    pose = _pose(T_parent_child)
    return {
        "timestamp": time_of(stamp_ns), "parent_frame_id": parent, "child_frame_id": child,
        "translation": pose["position"], "rotation": pose["orientation"],
    }  # fmt: skip


def cloud_message(stamp_ns: int, frame: str, points: Floats, origin: Floats) -> Message:
    """`foxglove.PointCloud` of points (N, 3)."""
    fields = [{"name": axis, "offset": 4 * k, "type": FLOAT32} for k, axis in enumerate("xyz")]
    data = base64.b64encode((points - origin).astype("<f4").tobytes()).decode()
    return {
        "timestamp": time_of(stamp_ns), "frame_id": frame, "pose": _at(origin), "point_stride": 12, "fields": fields,
        "data": data,
    }  # fmt: skip


def scene_message(entities: list[Message]) -> Message:
    """`foxglove.SceneUpdate` of entities."""
    return {"deletions": [], "entities": entities}


def entity(stamp_ns: int, frame: str, name: str, metadata: dict[str, str], **primitives: list[Message]) -> Message:
    """`foxglove.SceneEntity` that stays; `primitives` are lists by the names in PRIMITIVES."""
    return {
        "timestamp": time_of(stamp_ns), "frame_id": frame, "id": name, "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True, "metadata": [{"key": key, "value": value} for key, value in metadata.items()],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }  # fmt: skip


def line(kind: int, points: Floats, origin: Floats, colour: Colour) -> Message:
    """`foxglove.LinePrimitive` through points (N, 3); `kind` is a LINE_ of `foxglove_schemas`."""
    return {
        "type": kind, "pose": _at(origin), "thickness": _LINE_PX, "scale_invariant": True,
        "points": _points(points - origin), "color": _colour(colour), "colors": [], "indices": [],
    }  # fmt: skip


def triangles(mesh: Mesh, origin: Floats, colour: Colour) -> Message:
    """`foxglove.TriangleListPrimitive` of a mesh."""
    vertices, faces = mesh
    return {
        "pose": _at(origin), "points": _points(vertices - origin), "color": _colour(colour), "colors": [],
        "indices": faces.ravel().tolist(),
    }  # fmt: skip


def label(text: str, place: Floats, colour: Colour) -> Message:
    """`foxglove.TextPrimitive` at a position (3,)."""
    return {
        "pose": _at(place), "billboard": True, "font_size": _LABEL_M, "scale_invariant": False,
        "color": _colour(colour), "text": text,
    }  # fmt: skip


def _pose(T: Floats) -> Message:
    x, y, z, qx, qy, qz, qw = poses_to_xyzquat(T[None])[0].tolist()
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}}


def _at(place: Floats) -> Message:
    T = np.eye(4)
    T[:3, 3] = place
    return _pose(T)


def _points(points: Floats) -> list[Message]:
    return [{"x": x, "y": y, "z": z} for x, y, z in points.round(4).tolist()]


def _colour(colour: Colour) -> Message:
    return dict(zip("rgba", colour, strict=True))
