"""The forms of Foxglove's messages that we write, as JSON Schema (github.com/foxglove/foxglove-sdk, `schemas`).

Foxglove and Lichtblick know a message by the name of its schema, and take the types of its fields from the schema.
"""

from typing import Any

Schema = dict[str, Any]
FLOAT32 = 7  # foxglove.NumericType
LINE_STRIP, LINE_LOOP = 0, 1  # foxglove.LineType

_NUMBER: Schema = {"type": "number"}
_INTEGER: Schema = {"type": "integer"}
_FLAG: Schema = {"type": "boolean"}
_TEXT: Schema = {"type": "string"}
_BYTES: Schema = {"type": "string", "contentEncoding": "base64"}


def _object(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties, "required": list(properties)}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_TIME = _object("time", sec=_INTEGER, nsec=_INTEGER)
_DURATION = _object("duration", sec=_INTEGER, nsec=_INTEGER)
_VECTOR = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_COLOR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_FIELD = _object("foxglove.PackedElementField", name=_TEXT, offset=_INTEGER, type=_INTEGER)
_PAIR = _object("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)

_ARROW = _object(
    "foxglove.ArrowPrimitive", pose=_POSE, shaft_length=_NUMBER, shaft_diameter=_NUMBER, head_length=_NUMBER,
    head_diameter=_NUMBER, color=_COLOR,
)  # fmt: skip
_CUBE = _object("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_SPHERE = _object("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_CYLINDER = _object(
    "foxglove.CylinderPrimitive", pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOR
)
_LINE = _object(
    "foxglove.LinePrimitive", type=_INTEGER, pose=_POSE, thickness=_NUMBER, scale_invariant=_FLAG,
    points=_list(_POINT), color=_COLOR, colors=_list(_COLOR), indices=_list(_INTEGER),
)  # fmt: skip
_TRIANGLES = _object(
    "foxglove.TriangleListPrimitive", pose=_POSE, points=_list(_POINT), color=_COLOR, colors=_list(_COLOR),
    indices=_list(_INTEGER),
)  # fmt: skip
_LABEL = _object(
    "foxglove.TextPrimitive", pose=_POSE, billboard=_FLAG, font_size=_NUMBER, scale_invariant=_FLAG, color=_COLOR,
    text=_TEXT,
)  # fmt: skip
_MODEL = _object(
    "foxglove.ModelPrimitive", pose=_POSE, scale=_VECTOR, color=_COLOR, override_color=_FLAG, url=_TEXT,
    media_type=_TEXT, data=_BYTES,
)  # fmt: skip
PRIMITIVES = {
    "arrows": _ARROW, "cubes": _CUBE, "spheres": _SPHERE, "cylinders": _CYLINDER, "lines": _LINE,
    "triangles": _TRIANGLES, "texts": _LABEL, "models": _MODEL,
}  # fmt: skip
_ENTITY = _object(
    "foxglove.SceneEntity", timestamp=_TIME, frame_id=_TEXT, id=_TEXT, lifetime=_DURATION, frame_locked=_FLAG,
    metadata=_list(_PAIR), **{name: _list(primitive) for name, primitive in PRIMITIVES.items()},
)  # fmt: skip
_DELETION = _object("foxglove.SceneEntityDeletion", timestamp=_TIME, type=_INTEGER, id=_TEXT)

TRANSFORM = _object(
    "foxglove.FrameTransform", timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR,
    rotation=_QUATERNION,
)  # fmt: skip
POSE = _object("foxglove.PoseInFrame", timestamp=_TIME, frame_id=_TEXT, pose=_POSE)
CLOUD = _object(
    "foxglove.PointCloud", timestamp=_TIME, frame_id=_TEXT, pose=_POSE, point_stride=_INTEGER, fields=_list(_FIELD),
    data=_BYTES,
)  # fmt: skip
SCENE = _object("foxglove.SceneUpdate", deletions=_list(_DELETION), entities=_list(_ENTITY))
