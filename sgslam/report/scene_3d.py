"""The 3D view of a storey: data for `report_scene.js` as JSON, in whole millimetres from the plan's centre."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.report.plan_drawing import DrawnWall, PlanDrawing

Array = NDArray[np.float64]
LAYERS = (
    "bim-walls", "walls-matched", "walls-unmatched", "anchors-withdrawn", "odometry", "trajectory", "lost", "truth",
)  # fmt: skip


def scene_data(drawing: PlanDrawing) -> dict[str, Any]:
    """The scene as JSON: x east, y north, z up, from the plan's centre on the floor.

    `walls` is a list of `[layer, look, significant, x0, y0, x1, y1, z0, z1]`, with `layer` as in the legend and
    `look` the band of its deviation or the layer. `floors` holds for each room whether it is matched, and its outline
    `[x, y, ...]`; the pieces of `paths` by layer, and `keyframes`, are `[x, y, z, ...]`.
    """
    origin = np.array([*drawing.centre(), drawing.floor_z])
    walls = [_wall("bim-walls", w, origin) for w in drawing.bim_walls]
    walls += [_wall("anchors-withdrawn", w, origin) for w in drawing.withdrawn]
    walls += [_wall("walls-matched" if w.matched else "walls-unmatched", w, origin) for w in drawing.map_walls]
    outlines = [(r.outline, r.matched) for r in drawing.bim_rooms if r.outline is not None]
    return {
        "walls": walls,
        "floors": [[matched, _millimetres(outline - origin[:2])] for outline, matched in outlines],
        "paths": {
            kind: [_millimetres(path.points - origin) for path in pieces] for kind, pieces in drawing.paths.items()
        },
        "keyframes": _millimetres(drawing.keyframes - origin),
    }


def scene_layers(drawing: PlanDrawing, data: dict[str, Any]) -> dict[str, str]:
    """The labels of what the scene `data` holds."""
    present = {wall[0] for wall in data["walls"]} | data["paths"].keys()
    labels = {name: drawing.labels[name] for name in LAYERS if name in present}
    return labels | ({"keyframes": "keyframe"} if data["keyframes"] else {})


def _wall(layer: str, wall: DrawnWall, origin: Array) -> list[Any]:
    z = np.array(wall.z) - origin[2]
    look = f"band-{wall.band}" if wall.band else layer
    return [layer, look, int(wall.significant), *_millimetres(wall.ends - origin[:2]), *_millimetres(z)]


def _millimetres(metres: Array) -> list[int]:
    return np.round(metres.ravel() * 1000).astype(int).tolist()
