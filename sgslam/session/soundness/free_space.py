"""Free space: through how much of the walls that both plan and map have a map's rays lead.

In a sound map at its place, walls are opaque. In one that is warped, or in which two places are mapped as one, scans
look through the walls that others saw, for metres. A sliding door that is a wall in the plan is a narrow gap.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.mapping import KeyframeClouds

Floats = NDArray[np.float64]
_KEYFRAMES, _RAYS = 80, 150  # that are looked at, evenly spaced
_BEYOND = 0.4  # m beyond a wall from which on a ray leads through it
_NEAR = 0.3  # m from the sensor within which a wall tells nothing: it may stand in a door
_STEP = 0.3  # m, of the stretches in which walls are judged
_SEVERAL = 3  # rays through a stretch, for it to be looked through


def share_looked_through(poses: Floats, keyframes: list[int], clouds: KeyframeClouds, standing: SceneGraph) -> float:
    """The share of the length of `standing` walls through which rays of keyframes, at T_bim_sensor `poses` (K, 4, 4),
    lead."""
    floors = sorted((f.elevation, f.id) for f in standing.floors if f.elevation is not None)
    elevations = np.array([elevation for elevation, _ in floors])
    lines: dict[str | None, list[Floats]] = {}
    for wall in standing.wall_surfaces:
        centre, left = np.array(wall.centroid), np.array([-wall.normal[1], wall.normal[0]])
        own = [np.stack([centre + a * left, centre + b * left]) for _, a, b, whole in wall.parts if whole and a < b]
        lines.setdefault(wall.floor, []).extend(own)
    trees = {floor: shapely.STRtree(shapely.linestrings(np.stack(own))) for floor, own in lines.items() if own}
    through: dict[tuple[str | None, int, int], int] = {}
    for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), _KEYFRAMES)).astype(int)).tolist():
        points, T = clouds[keyframes[k]], poses[k]
        below = int(np.searchsorted(elevations, T[2, 3], side="right")) - 1
        floor = floors[max(below, 0)][1] if floors else None
        if not len(points) or floor not in trees:
            continue
        rays = (points[:: -(-len(points) // _RAYS)] @ T[:3, :3].T)[:, :2]
        length = np.hypot(*rays.T)
        rays, length = rays[length > _NEAR + _BEYOND], length[length > _NEAR + _BEYOND]
        begin, end = (T[:2, 3] + rays * (at / length)[:, None] for at in (np.full(len(rays), _NEAR), length - _BEYOND))
        segments = shapely.linestrings(np.stack([begin, end], axis=1))
        i, j = trees[floor].query(segments, predicate="intersects")
        walls = trees[floor].geometries[j]
        at = shapely.line_locate_point(walls, shapely.centroid(shapely.intersection(segments[i], walls)))
        for line, step in zip(j.tolist(), (at // _STEP).astype(int).tolist(), strict=True):
            through[floor, line, step] = through.get((floor, line, step), 0) + 1
    stretches = sum(int(shapely.length(line) // _STEP) + 1 for tree in trees.values() for line in tree.geometries)
    return sum(count >= _SEVERAL for count in through.values()) / max(stretches, 1)
