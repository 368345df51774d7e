"""What differs between two results: plans' A-graphs, answers of matchers. Each function gives lines; none if equal."""

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

LISTED = 8  # plans, maps, files or values that are named, at most; others are counted
KEYS = ("id", "GlobalId", "s_id", "a_id")  # that name the entries of a list, where they differ
Json = dict[str, Any]


def plan_lines(old: Mapping[str, Json], new: Mapping[str, Json]) -> list[str]:
    """Of A-graphs by plan: which plans appear or vanish, and what moved in which."""
    lines, moved = _names("plans", old, new), [name for name in old if name in new and old[name] != new[name]]
    if not moved:
        return lines
    counts = [_count(old, new, kind) for kind in ("rooms", "wall_surfaces", "doors")]
    most, where = max((_shift(old[name], new[name]), name) for name in moved)
    lines.append(f"{len(moved)} of {len(old)} plans moved, by id {most:.3g} m at most ({where}): {', '.join(counts)}")
    for name in moved[:LISTED]:
        lines += [f"{name}: {line}" for line in _plan(old[name], new[name])]
    return lines


def _count(old: Mapping[str, Json], new: Mapping[str, Json], kind: str) -> str:
    """The number of nodes, and how many vanish and appear if equal ones with other ids are the same."""
    known, found = (
        Counter(
            json.dumps([name, {**node, "id": ""}])
            for name, plan in plans.items()
            for node in plan.get("graph", {}).get(kind, ())
        )
        for plans in (old, new)
    )
    forms = f"{(known - found).total()} vanish, {(found - known).total()} appear"
    return f"{kind} {known.total()} -> {found.total()} (whatever the ids: {forms})"


def _shift(old: Json, new: Json) -> float:
    """By how far the nodes that both graphs have moved, at most."""
    shifts = [0.0]
    for kind in ("rooms", "wall_surfaces", "doors"):
        known, found = ({n["id"]: n for n in plan.get("graph", {}).get(kind, ())} for plan in (old, new))
        shifts += [node_shift(known[name], found[name]) for name in known.keys() & found.keys()]
    return max(shifts)


def _plan(old: Json, new: Json) -> list[str]:
    if "graph" not in old or "graph" not in new:
        return [f"{_outcome(old)} -> {_outcome(new)}"]
    lines = graph_lines(old["graph"], new["graph"])
    return lines if old["notices"] == new["notices"] else [*lines, f"notices {old['notices']} -> {new['notices']}"]


def _outcome(plan: Json) -> str:
    return f"error '{plan['error']}'" if "error" in plan else f"a graph of {len(plan['graph']['rooms'])} rooms"


def graph_lines(old: Json, new: Json) -> list[str]:
    """Of two scene graphs: the nodes by id that appear, vanish or move, and by how much."""
    lines = []
    for kind in dict.fromkeys([*old, *new]):
        before: Any = old.get(kind)
        after: Any = new.get(kind)
        if before == after:
            continue
        if not all(isinstance(nodes, list) and all("id" in n for n in nodes) for nodes in (before, after)):
            lines += json_lines(before, after, kind)
            continue
        known, found = ({n["id"]: n for n in nodes} for nodes in (before, after))
        lines += _names(kind, known, found)
        both = [(n, found[i]) for i, n in known.items() if i in found and n != found[i]]
        if both:
            shift = max(node_shift(a, b) for a, b in both)
            fields = Counter(f for a, b in both for f in {*a, *b} if a.get(f) != b.get(f))
            names = ", ".join(f"{f} {n}" for f, n in fields.most_common())
            lines.append(f"{len(both)} {kind} changed ({names}), moved by {shift:.3g} m at most")
        if known == found and len(known) == len(before) and list(known) != list(found):
            lines.append(f"{kind}: another order")
    return lines


def node_shift(a: Json, b: Json) -> float:
    """By how far a node moved, in metres: its centroid, its pose, a polygon's corners from the nearest of the other."""
    shifts = [math.dist(a[key][:3], b[key][:3]) for key in ("centroid", "pose") if key in a]
    p, q = a.get("polygon") or (), b.get("polygon") or ()
    for some, others in ((p, q), (q, p)):
        shifts += [min(math.dist(corner, other) for other in others) for corner in some if others]
    return max(shifts, default=0.0)


def match_lines(old: Mapping[str, Json], new: Mapping[str, Json]) -> list[str]:
    """Of answers by map: how statuses, motions and pairs changed."""
    lines = _names("maps", old, new)
    both = [(name, old[name], new[name]) for name in old if name in new and old[name] != new[name]]
    if not both:
        return lines
    lines.append(f"{len(both)} of {len(old)} answers differ, first of them: {both[0][0]}")
    table = Counter((a["status"], b["status"]) for _, a, b in both if a["status"] != b["status"])
    lines += [f"status {before} -> {after}: {count}" for (before, after), count in table.most_common()]
    motions = [(a["T_a_s"], b["T_a_s"]) for _, a, b in both if a["T_a_s"] and b["T_a_s"] and a["T_a_s"] != b["T_a_s"]]
    if motions:
        metres = sorted(math.dist(a[1:], b[1:]) for a, b in motions)
        degrees = sorted(abs(math.degrees(math.remainder(a[0] - b[0], math.tau))) for a, b in motions)
        lines.append(f"{len(motions)} motions moved: {_spread(metres, 'm')}; {_spread(degrees, 'degrees')}")
    for kind in ("rooms", "wall_surfaces"):
        gone = appeared = 0
        confidence = 0.0
        for _, a, b in both:
            p, q = ({(s, t): c for s, t, c in answer[kind]} for answer in (a, b))
            gone, appeared = gone + len(p.keys() - q.keys()), appeared + len(q.keys() - p.keys())
            confidence = max([confidence, *(abs(p[k] - q[k]) for k in p.keys() & q.keys())])
        if gone or appeared or confidence:
            lines.append(f"pairs of {kind}: {gone} vanish, {appeared} appear; confidences move by {confidence:.3g}")
    for field in ("floor", "reason", "hypotheses"):
        if count := sum(a[field] != b[field] for _, a, b in both):
            lines.append(f"{field}: differs in {count}")
    return lines


def _spread(values: Sequence[float], unit: str) -> str:
    return f"{values[-1]:.3g} {unit} at most, median {values[len(values) // 2]:.3g}"


def json_lines(old: Any, new: Any, where: str = "", left_out: re.Pattern[str] | None = None) -> list[str]:
    """Of two JSON values: paths that appear, vanish or differ, and the largest change of a number. Paths in which
    `left_out` is found are not compared."""
    changes = [c for c in _changes(old, new, where) if left_out is None or not left_out.search(c[0])]
    if not changes:
        return []
    numbers = [(abs(b - a), path, a, b) for path, a, b in changes if _is_number(a) and _is_number(b)]
    lines = [f"{len(changes)} values differ"]
    if numbers:
        most, path, a, b = max(numbers, key=lambda found: found[0])
        lines[0] += f"; the largest change of a number is {most:.3g}, {path}: {a} -> {b}"
    others = [(path, a, b) for path, a, b in changes if not (_is_number(a) and _is_number(b))]
    lines += [f"{path}: {_short(a)} -> {_short(b)}" for path, a, b in others[:LISTED]]
    return lines


def _changes(old: Any, new: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    for key in KEYS:
        if _has_names(old, key) and _has_names(new, key):
            old, new = {entry[key]: entry for entry in old}, {entry[key]: entry for entry in new}
            break
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            yield from _changes(old.get(key), new.get(key), f"{path}.{key}" if path else key)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _changes(a, b, f"{path}[{k}]")
    elif old != new and not (old != old and new != new):  # NaN is like NaN
        yield path, old, new


def _has_names(value: Any, key: str) -> bool:
    """Whether a value is a list of objects, of which each has another value of this key."""
    if not isinstance(value, list) or not all(isinstance(entry, dict) and key in entry for entry in value):
        return False
    return len({str(entry[key]) for entry in value}) == len(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _short(value: Any) -> str:
    text = f"{len(value)} entries" if isinstance(value, (list, dict)) and len(value) > 3 else repr(value)
    return text if len(text) < 120 else f"{text[:117]}..."


def _names(kind: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    lines = []
    for what, names in (("vanish", [n for n in old if n not in new]), ("appear", [n for n in new if n not in old])):
        if names:
            more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
            lines.append(f"{len(names)} {kind} {what}: {', '.join(names[:LISTED])}{more} ({len(old)} -> {len(new)})")
    return lines
