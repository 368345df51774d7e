"""The 3D view of a storey: data for `report_scene.js` as JSON, in whole millimetres from the plan's centre."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.report.drawn_paths import Mark
from sgslam.report.plan_drawing import PlanDrawing

Array = NDArray[np.float64]
WALLS = ("bim-walls", "walls-matched", "walls-unmatched", "anchors-withdrawn")
PATHS = ("odometry", "trajectory", "lost", "truth")


def scene_data(drawing: PlanDrawing) -> dict[str, Any]:
    """The scene as JSON: x east, y north, z up, from the plan's centre on the floor.

    `walls` is a list of `[layer, look, significant, x0, y0, x1, y1, z0, z1]`, with `layer` as in the legend and
    `look` the band of its deviation or the layer. `floors` holds for each room whether it is matched, and its outline
    `[x, y, ...]`; the pieces of `paths` by layer, and `keyframes`, are `[x, y, z, ...]`.
    """
    origin = np.array([*drawing.centre(), drawing.floor_z])
    areas = [(layer, mark.points) for layer in ("rooms", "rooms-matched") for mark in drawing.layers[layer]]
    return {
        "walls": [_wall(layer, mark, origin) for layer in WALLS for mark in drawing.layers[layer]],
        "floors": [[layer == "rooms-matched", _millimetres(outline - origin[:2])] for layer, outline in areas],
        "paths": {
            kind: [_millimetres(path.points - origin) for path in drawing.layers[kind]]
            for kind in PATHS
            if drawing.layers[kind]
        },
        "keyframes": _millimetres(drawing.keyframes - origin),
    }


def scene_layers(drawing: PlanDrawing) -> dict[str, str]:
    """The labels of what the scene holds."""
    labels = {name: drawing.labels[name] for name in (*WALLS, *PATHS) if drawing.layers[name]}
    return labels | ({"keyframes": "keyframe"} if len(drawing.keyframes) else {})


def _wall(layer: str, wall: Mark, origin: Array) -> list[Any]:
    look = next((look for look in wall.looks if look.startswith("band-")), layer)
    z = np.array([wall.points[0, 2], wall.top]) - origin[2]
    ends = wall.points[:, :2] - origin[:2]
    return [layer, look, int("significant" in wall.looks), *_millimetres(ends), *_millimetres(z)]


def _millimetres(metres: Array) -> list[int]:
    return np.round(metres.ravel() * 1000).astype(int).tolist()
