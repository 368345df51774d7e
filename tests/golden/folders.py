"""What differs between two output folders of a run, file by file. Poses are compared by stamp."""

import csv
import hashlib
import json
import math
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .differences import graph_lines, json_lines

LEFT_OUT = {
    "state.bin": "holds seconds and paths; what can be read of it is that a run resumes from it (the run `resumed`)",
}
# Values that differ between any two runs: wall-clock and CPU seconds, the latencies of a live run, the version.
TIMES = re.compile(r"(^|\.)(seconds|cpu_seconds|live|took_s|Version)\b")
MASKED = {  # in texts: dates with a time of the day, and the seconds of the report
    "DATE": re.compile(r"\b20\d\d-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?([.,]\d+)?(Z|[+-]\d\d:?\d\d| UTC)?"),
    "TOTAL": re.compile(r"<b>[\d.,]+ \w+</b><span>total time</span>"),
    "STAGES": re.compile(r"<h2>Time by stage</h2>.*?</section>", re.DOTALL),
}
GRAPHS = ("s_graph.json", "a_graph.json")
TEXTS = {".html", ".log", ".yaml", ".g2o", ".txt", ".xml", ".rels", ".bcf", ".bcfv", ".version", ".ifc", ".jsonl"}
ARCHIVES = {".bcf", ".bcfzip", ".xlsx"}
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def folder_lines(old: Path, new: Path) -> list[str]:
    """What differs between two folders; no line if nothing does."""
    before, after = _files(old), _files(new)
    lines = [f"{n}: is missing" for n in sorted(before.keys() - after.keys())]
    lines += [f"{n}: is new" for n in sorted(after.keys() - before.keys())]
    for name in sorted(before.keys() & after.keys()):
        a, b = before[name].read_bytes(), after[name].read_bytes()
        if a != b:
            lines += [f"{name}: {line}" for line in content_lines(name, a, b)]
    return lines


def _files(folder: Path) -> dict[str, Path]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path for path in paths if path.name not in LEFT_OUT}


def content_lines(name: str, old: bytes, new: bytes) -> list[str]:
    """What differs between two files of one name, by its suffix."""
    suffix = Path(name).suffix.lower()
    if suffix in ARCHIVES and old[:2] == new[:2] == b"PK":
        return _archive_lines(old, new)
    if suffix == ".json":
        a, b = json.loads(old), json.loads(new)
        return graph_lines(a, b) if Path(name).name in GRAPHS else json_lines(a, b, "", TIMES)
    if suffix == ".tum":
        return trajectory_lines(old.decode(), new.decode())
    if suffix == ".csv":
        return table_lines(old.decode(), new.decode())
    if suffix == ".sha256":
        return table_lines(f"file,hash\n{old.decode()}", f"file,hash\n{new.decode()}")
    if suffix in TEXTS:
        return text_lines(old.decode(), new.decode())
    digests = (hashlib.sha256(content).hexdigest()[:8] for content in (old, new))
    return [f"the hash differs ({' -> '.join(digests)}), {len(old)} -> {len(new)} bytes"]


def _archive_lines(old: bytes, new: bytes) -> list[str]:
    """The members are compared, since an archive holds the dates of its files."""
    from io import BytesIO

    with zipfile.ZipFile(BytesIO(old)) as a, zipfile.ZipFile(BytesIO(new)) as b:
        known, found = set(a.namelist()), set(b.namelist())
        lines = [f"{n} is missing" for n in sorted(known - found)] + [f"{n} is new" for n in sorted(found - known)]
        for name in sorted(known & found):
            if (p := a.read(name)) != (q := b.read(name)):
                lines += [f"{name}: {line}" for line in content_lines(name, p, q)]
    return lines


def trajectory_lines(old: str, new: str) -> list[str]:
    """Two TUM files, pose by pose of the same stamp."""
    known, found = _poses(old), _poses(new)
    lines = _stamps(known, found)
    both = [(known[stamp], found[stamp]) for stamp in known if stamp in found]
    if moved := sum(a != b for a, b in both):
        metres = [math.dist(a[:3], b[:3]) for a, b in both]
        degrees = [_turned(a[3:], b[3:]) for a, b in both]
        lines.append(f"{moved} of {len(both)} poses moved: {_most(metres, 'm')}; {_most(degrees, 'degrees')}")
    return lines


def _poses(text: str) -> dict[str, tuple[float, ...]]:
    rows = (line.split() for line in text.splitlines() if line and not line.startswith("#"))
    return {row[0]: tuple(map(float, row[1:])) for row in rows}


def _turned(p: Sequence[float], q: Sequence[float]) -> float:
    """The angle between two unit quaternions, in degrees."""
    sign = 1.0 if sum(x * y for x, y in zip(p, q, strict=True)) >= 0 else -1.0
    return math.degrees(4 * math.asin(min(1.0, math.dist(p, [sign * x for x in q]) / 2)))


def _most(values: list[float], unit: str) -> str:
    return f"{max(values):.3g} {unit} at most, RMS {math.hypot(*values) / math.sqrt(len(values)):.3g}"


def table_lines(old: str, new: str) -> list[str]:
    """Two CSV files, row by row: by their first column where it names each row, else by their order."""
    (header, known), (other, found) = _rows(old), _rows(new)
    lines = [] if header == other else [f"columns {header} -> {other}"]
    lines += _stamps(known, found)
    changed: Counter[str] = Counter()
    most: dict[str, float] = {}
    for key in known.keys() & found.keys():
        a, b = dict(zip(header, known[key], strict=False)), dict(zip(other, found[key], strict=False))
        for column in [c for c in a if c in b and a[c] != b[c]]:
            changed[column] += 1
            if NUMBER.fullmatch(a[column]) and NUMBER.fullmatch(b[column]):
                most[column] = max(most.get(column, 0.0), abs(float(a[column]) - float(b[column])))
    for column, count in changed.items():
        by = f", by {most[column]:.3g} at most" if column in most else ""
        lines.append(f"{column}: {count} of {len(known)} cells differ{by}")
    return lines


def _rows(text: str) -> tuple[list[str], dict[str, list[str]]]:
    header, *rows = list(csv.reader(text.splitlines())) or [[]]
    named = len({row[0] for row in rows if row}) == len(rows)
    return header, {row[0] if named else f"row {k}": row for k, row in enumerate(rows)}


def _stamps(known: Mapping[str, object], found: Mapping[str, object]) -> list[str]:
    gone, more = [k for k in known if k not in found], [k for k in found if k not in known]
    lines = [f"{len(gone)} of {len(known)} rows vanish, the first is {gone[0]}"] if gone else []
    return lines + ([f"{len(more)} rows appear, the first is {more[0]}"] if more else [])


def text_lines(old: str, new: str) -> list[str]:
    """Two texts, line by line without dates and seconds: how many lines differ, and by how much the numbers in them."""
    before, after = masked(old).splitlines(), masked(new).splitlines()
    if before == after:
        return []
    gone, more = Counter(before) - Counter(after), Counter(after) - Counter(before)
    pairs = list(zip(gone.elements(), more.elements(), strict=False))
    others = [(a, b) for a, b in pairs if NUMBER.split(a) != NUMBER.split(b)]
    if gone.total() == more.total() and not others:
        numbers = [zip(NUMBER.findall(a), NUMBER.findall(b), strict=True) for a, b in pairs]
        most = max((abs(float(x) - float(y)) for line in numbers for x, y in line), default=0.0)
        how = f"differ, in numbers, by {most:.3g} at most" if pairs else "differ, but for their order"
        return [f"{len(pairs)} of {len(before)} lines {how}"]
    shown = [f"{a.strip()[:100]} -> {b.strip()[:100]}" for a, b in others[:2]]
    return [f"{gone.total()} of {len(before)} lines vanish, {more.total()} appear", *shown]


def masked(text: str) -> str:
    """A text without what differs between any two runs."""
    for word, pattern in MASKED.items():
        text = pattern.sub(word, text)
    return text


def settled(folder: Path, places: dict[Path, str], bulky: Callable[[Path], bool]) -> None:
    """Makes an output folder comparable: paths in texts become names, bulky files their hashes."""
    hashes: dict[Path, list[str]] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        if bulky(path):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            hashes.setdefault(path.parent, []).append(f"{path.name},{digest}\n")
            path.unlink()
        elif path.suffix in {*TEXTS, ".json"} and not zipfile.is_zipfile(path):
            text = path.read_text()
            for place, name in places.items():
                text = text.replace(str(place), name)
            path.write_text(text)
    for parent, lines in hashes.items():
        (parent / "files.sha256").write_text("".join(lines))
