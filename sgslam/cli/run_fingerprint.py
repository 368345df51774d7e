"""What a run is of: its scans, building and settings, so that one that goes on is not given others."""

import hashlib
import json
from pathlib import Path
from typing import Any

from data import SceneGraph, UserError
from data.scans import ScanSource
from sgslam.config import Config
from sgslam.session.checkpoints import FILE

_PIECE = 1 << 20  # bytes of a file's beginning and of its end


def inputs_of(
    scans: ScanSource, a_graph: SceneGraph | None, config: Config, told: dict[str, Any], known: Path | None = None
) -> dict[str, Any]:
    """What tells a run from others, as JSON; `told` is what else its user told, `known` the folder of the known map."""
    return {
        "scans": _fingerprint(scans),
        "building": None if a_graph is None else _digest(json.dumps(a_graph.to_dict(), sort_keys=True).encode()),
        "map": None if known is None else _digest((known / FILE).read_bytes()),
        "config": config.model_dump(mode="json"),
        "told": json.loads(json.dumps(told)),
    }


def check_same(folder: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    """Raises UserError, in one line, where a run that is to go on is given other inputs than it had."""
    for name, what in (("scans", "other scans"), ("building", "another building"), ("map", "another map")):
        if before.get(name) != now[name]:
            raise UserError(f"--resume {folder}: that run is of {what}; give the same again, or run it anew")
    for name in ("config", "told"):
        unlike = _first_unlike(before.get(name) or {}, now[name])
        if unlike is not None:
            raise UserError(f"--resume {folder}: that run had {unlike}; give the same again, or run it anew")


def _first_unlike(before: dict[str, Any], now: dict[str, Any], prefix: str = "") -> str | None:
    for key in sorted({*before, *now}):
        a, b = before.get(key), now.get(key)
        if a == b:
            continue
        if isinstance(a, dict) and isinstance(b, dict):
            return _first_unlike(a, b, f"{prefix}{key}.")
        return f"{prefix}{key} = {json.dumps(a)}, not {json.dumps(b)}"
    return None


def _fingerprint(scans: ScanSource) -> str:
    """Of a folder its files' names and sizes and the stamps; of a file its size, beginning and end."""
    parts = [len(scans)] if scans.stamps_ns is None else scans.stamps_ns.tolist()
    if scans.path.is_dir():
        shown = sorted(f for f in scans.path.iterdir() if f.is_file())
        return _digest(json.dumps([parts, [(f.name, f.stat().st_size) for f in shown]]).encode())
    size = scans.path.stat().st_size
    with scans.path.open("rb") as file:
        ends = file.read(_PIECE)
        file.seek(max(0, size - _PIECE))
        return _digest(json.dumps([parts, size]).encode() + ends + file.read(_PIECE))


def _digest(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()
