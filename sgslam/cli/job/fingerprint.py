"""Fingerprint of a run's inputs (scans, building, settings), so that a resumed run gets the same inputs."""

import hashlib
import json
from pathlib import Path
from typing import Any

from data import SceneGraph, UserError
from data.scans import ScanSource
from sgslam.config import Config
from sgslam.session.checkpoints import FILE

_PIECE = 1 << 20  # bytes hashed at the beginning and at the end of a file


def run_fingerprint(
    scans: ScanSource, a_graph: SceneGraph | None, config: Config, arguments: dict[str, Any], prior: Path | None = None
) -> dict[str, Any]:
    """The identity of a run's inputs, in JSON form; `arguments` are other options of the user, `prior` is the folder of
    the prior map."""
    return {
        "scans": _scans_digest(scans),
        "building": None if a_graph is None else _digest(json.dumps(a_graph.to_dict(), sort_keys=True).encode()),
        "map": None if prior is None else _digest((prior / FILE).read_bytes()),
        "config": config.model_dump(mode="json"),
        "told": json.loads(json.dumps(arguments)),
    }


def check_unchanged(folder: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    """Raises UserError if the inputs `now` differ from those `before` of the run to be resumed."""
    for name, what in (("scans", "other scans"), ("building", "another building"), ("map", "another map")):
        if before.get(name) != now[name]:
            raise UserError(f"--resume {folder}: that run used {what}; give the same again, or start a new run")
    for name in ("config", "told"):
        difference = _first_difference(before.get(name) or {}, now[name])
        if difference is not None:
            raise UserError(f"--resume {folder}: that run had {difference}; give the same again, or start a new run")


def _first_difference(before: dict[str, Any], now: dict[str, Any], prefix: str = "") -> str | None:
    for key in sorted({*before, *now}):
        a, b = before.get(key), now.get(key)
        if a == b:
            continue
        if isinstance(a, dict) and isinstance(b, dict):
            return _first_difference(a, b, f"{prefix}{key}.")
        return f"{prefix}{key} = {json.dumps(a)}, not {json.dumps(b)}"
    return None


def _scans_digest(scans: ScanSource) -> str:
    """Hash of the stamps and, for a folder, the files' names and sizes; for a file, its size, beginning and end."""
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
