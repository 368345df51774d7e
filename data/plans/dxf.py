"""Walls of a DXF drawing's model space as an A-graph: layers by their names, units by its header or its walls.

x and y are the drawing's own, in metres. Needs ezdxf (the extra `dxf`).
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError, refusing, required
from data.plans.flat_plan import DrawnWalls, FlatStorey, even_odd, graph_of_storeys, walls_of_lines
from data.scene_graph import SceneGraph

Array = NDArray[np.float64]
WALLS = (
    "wall", "mauer", "wand", "wände", "waende", "muro", "muri", "mur", "murs", "cloison", "paret", "pared", "vegg",
    "vägg", "seinä", "ściana", "sciana", "partition", "стен", "墙", "壁", "window", "fenster", "fenêtre", "fenetre",
    "ventana", "finestra", "glaz", "curtain", "column", "stütze", "stuetze", "poteau", "pillar",
)  # fmt: skip
NOT_WALLS = ("furn", "möbel", "dim", "text", "anno", "ceil", "decke", "iden", "tag", "grid")
UNITS = {  # $INSUNITS -> metres
    1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 10: 0.9144, 14: 0.1, 15: 10.0, 16: 100.0, 21: 0.30480061,
}  # fmt: skip
NAMES = {1.0: "metres", 1e-2: "centimetres", 1e-3: "millimetres", 0.0254: "inches", 0.3048: "feet"}
DRAWN = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "HATCH", "SOLID", "TRACE")
EXPANDED = ("INSERT", "MLINE")
SMALLEST, LARGEST, USUAL = 2.0, 3000.0, 40.0  # m: of a building's plan
DEEPEST = 12  # blocks within blocks
MOST, LINES_A_BLOCK = 2_000_000, 40  # line segments; as many take as long as a block
CURVE = 16  # chords of a bow


@dataclass
class _Drawn:
    """The content of one layer, in the drawing's units."""

    segments: list[Array] = field(default_factory=list)  # each (K, 2, 2)
    filled: list[list[Array]] = field(default_factory=list)  # rings (N, 2) of each hatch or solid

    def count(self) -> int:
        return sum(map(len, self.segments)) + len(self.filled)


def read_dxf(path: Path | str, layers: Sequence[str] = ()) -> tuple[SceneGraph, tuple[str, ...]]:
    """Returns the A-graph of a drawing, one storey at z = 0, and notices (layers, units, rooms found).

    `layers` names those with the walls; by default those whose names suggest it. Raises UserError for a file that is
    missing or no DXF, for unknown layers, and if no layer is recognised as walls or it is empty.
    """
    path = Path(path)
    ezdxf = required("ezdxf", f"{path}: DXF", "dxf")
    with refusing(f"{path}: no DXF file, or a broken one", "export it as DXF again"):
        drawing = ezdxf.readfile(path)
        by_layer = _by_layer(drawing, path)
    chosen, notices = _chosen(by_layer, layers, path)
    segments = np.concatenate([np.empty((0, 2, 2)), *(s for name in chosen for s in by_layer[name].segments)])
    filled = [rings for name in chosen for rings in by_layer[name].filled]
    with refusing(f"{path}: its lines give no plan", "give --layer"):
        scale, message = _scale(drawing, segments, filled, path)
        walls = _walls(segments, filled, scale)
        graph, made = graph_of_storeys([FlatStorey(path.stem, walls.area)], str(path))
    if not walls.is_double and not filled:
        message.append("walls are drawn as single lines; a thickness of 0.1 m is assumed")
    return graph, (*notices, *message, *made)


def _by_layer(drawing: Any, path: Path) -> dict[str, _Drawn]:
    found: dict[str, _Drawn] = defaultdict(_Drawn)
    lines = 0
    for layer, entity in _exploded(drawing.modelspace(), "0", 0):
        lines += _add(found[layer], entity)
        if lines > MOST:  # blocks within blocks can exceed any memory
            raise UserError(
                f"{path}: holds over {MOST:,} lines, or {MOST // LINES_A_BLOCK:,} blocks; purge the drawing"
            )
    return {name: drawn for name, drawn in found.items() if drawn.count()}


def _exploded(entities: Any, layer: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Entities with their layers; blocks and multilines are followed by what is in them, of which layer 0 means their
    own."""
    for entity in entities:
        own = entity.dxf.get("layer", "0")
        own = layer if own == "0" else own
        kind = entity.dxftype()
        if kind in DRAWN or (kind in EXPANDED and depth < DEEPEST):
            yield own, entity
        if kind in EXPANDED and depth < DEEPEST:
            for one in entity.multi_insert() if kind == "INSERT" and entity.mcount > 1 else [entity]:
                yield from _exploded(one.virtual_entities(), own, depth + 1)


def _add(drawn: _Drawn, entity: Any) -> int:
    """Adds an entity's lines in plan and returns their number, for a block what it costs. Broken entities are
    skipped."""
    from ezdxf import path as paths

    kind = entity.dxftype()
    if kind in EXPANDED:
        return LINES_A_BLOCK * (entity.mcount if kind == "INSERT" else 1)
    try:
        if kind == "HATCH":
            rings = [_flat(p) for p in paths.from_hatch(entity)]
        elif kind in ("SOLID", "TRACE"):
            rings = [np.array([[v.x, v.y] for v in entity.wcs_vertices()])]
        else:
            points = _flat(paths.make_path(entity))
            steps = np.stack([points[:-1], points[1:]], axis=1)
            steps = steps[np.any(steps[:, 0] != steps[:, 1], axis=1)]
            if len(steps) and np.isfinite(steps).all():
                drawn.segments.append(steps)
            return len(steps)
    except (ValueError, TypeError, ZeroDivisionError, ArithmeticError, AttributeError, IndexError):
        return 0
    good = [ring for ring in rings if len(ring) >= 3 and np.isfinite(ring).all()]
    drawn.filled += [good] if good else []
    return sum(map(len, good))


def _flat(path: Any) -> Array:
    return np.array([[v.x, v.y] for v in path.approximate(CURVE)], dtype=float).reshape(-1, 2)


def _chosen(by_layer: dict[str, _Drawn], layers: Sequence[str], path: Path) -> tuple[list[str], list[str]]:
    """The layers of the walls, and notices."""
    fullest = sorted(by_layer.items(), key=lambda item: -item[1].count())[:12]
    listed = ", ".join(f"{name} ({drawn.count()})" for name, drawn in fullest)
    if not by_layer:
        raise UserError(f"{path}: no lines in its model space; give a plan with walls")
    if layers:
        wanted = {name.casefold() for name in layers}
        known = [name for name in by_layer if name.casefold() in wanted]
        missing = wanted - {name.casefold() for name in known}
        if missing:
            raise UserError(f"--layer {min(missing)}: no such layer with lines in {path}; there are: {listed}")
        return known, []
    chosen = [name for name in by_layer if is_wall_layer(name)] or (list(by_layer) if len(by_layer) == 1 else [])
    if not chosen:
        raise UserError(f"{path}: no layer's name says walls; choose layers with --layer; there are: {listed}")
    return chosen, [f"walls are taken from the layers {', '.join(sorted(chosen))}"]


def is_wall_layer(name: str) -> bool:
    """Whether a layer's name (`A-WALL-FULL`, `Aussenwände`, `plan$0$MUR`) means walls or what closes them."""
    words = [w for w in re.split(r"[^\w]|_|\d", name.casefold().rpartition("$")[2]) if w]
    if any(word.startswith(no) for word in words for no in NOT_WALLS):
        return False
    # other words may contain a short one by chance
    inside = [known for known in WALLS if len(known) >= 4 or not known.isascii()]
    return any(word in WALLS or any(known in word for known in inside) for word in words)


def _scale(drawing: Any, segments: Array, filled: list[list[Array]], path: Path) -> tuple[float, list[str]]:
    """Metres per unit, and notices: from the header, else the unit that gives walls a plausible thickness."""
    corners = np.concatenate([segments.reshape(-1, 2), *(r for rings in filled for r in rings)])
    extent = float(np.ptp(corners, axis=0).max())
    stated = UNITS.get(_header(drawing, "$INSUNITS"))
    if stated is not None and SMALLEST <= extent * stated <= LARGEST:
        return stated, []
    metric = _header(drawing, "$MEASUREMENT", 1) != 0
    possible = [u for u in ((1.0, 1e-2, 1e-3) if metric else (0.0254, 0.3048)) if SMALLEST <= extent * u <= LARGEST]
    if not possible:
        raise UserError(f"{path}: its walls extend over {extent:g} units, no building's size in any unit; scale it")
    double = {u: len(possible) == 1 or _walls(segments, filled, u).is_double for u in possible}
    best = max(possible, key=lambda u: (double[u], -abs(float(np.log(extent * u / USUAL)))))
    why = "its units are not set" if stated is None else f"in its stated units it would be {extent * stated:g} m wide"
    return best, [f"{why}: the drawing is taken to be in {NAMES[best]}, {extent * best:.1f} m wide"]


def _header(drawing: Any, name: str, default: int = 0) -> int:
    try:
        return int(drawing.header.get(name, default))
    except (TypeError, ValueError):
        return default


def _walls(segments: Array, filled: list[list[Array]], scale: float) -> DrawnWalls:
    return walls_of_lines(segments * scale, [even_odd([ring * scale for ring in rings]) for rings in filled])
