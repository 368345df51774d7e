"""The factor log: all factors that hold now, and every event of a factor with its time, origin and reason."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

from data.common.files import write_atomically
from data.geometry.poses import poses_to_xyzquat

Key = tuple[int | str, ...]
Floats = NDArray[np.float64]
Kind = Literal["start", "odometry", "wall", "level", "room", "loop", "anchor"]
KINDS: tuple[Kind, ...] = ("start", "odometry", "wall", "level", "room", "loop", "anchor")
_log = logging.getLogger(__name__)
POSE_GRAPH = "pose_graph.g2o"
# GTSAM: rotation (rad), translation; g2o: translation, vector part of the unit quaternion (half the angle)
_UNITS = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True)
class Entry:
    """A factor, its origin `by` (odometry, a match, ...), and the reason `why`. The factor of a restored run is None
    until it is made again."""

    factor: gtsam.NonlinearFactor | None
    by: str
    why: str


@dataclass(frozen=True)
class FactorEvent:
    """A change of a factor at a number of keyframes; `key` identifies it among those of its kind."""

    keyframes: int
    kind: Kind
    key: Key
    what: Literal["added", "withdrawn", "barred", "refused"]
    by: str
    why: str


class FactorLog:
    """All factors by kind in the order in which they were added, so that equal logs give equal graphs."""

    def __init__(self) -> None:
        self._held: dict[Kind, dict[Key, Entry]] = {kind: {} for kind in KINDS}
        self._barred: set[tuple[Kind, Key]] = set()
        self._refused: set[tuple[Kind, Key]] = set()
        self.events: list[FactorEvent] = []

    def state(self) -> dict[str, Any]:
        """Returns the origins by key, and the events, as a tree; without the factors themselves."""
        held = {kind: {key: entry.by for key, entry in entries.items()} for kind, entries in self._held.items()}
        return {"held": held, "barred": self._barred, "refused": self._refused, "events": self.events}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` returned, with the factors that are held already."""
        for kind, held in self._held.items():
            self._held[kind] = {key: held.get(key, Entry(None, by, "")) for key, by in state["held"][kind].items()}
        self._barred, self._refused, self.events = state["barred"], state["refused"], state["events"]

    def held(self, kind: Kind) -> dict[Key, Entry]:
        """The factors of a kind that hold now, by key."""
        return self._held[kind]

    def __iter__(self) -> Iterator[tuple[Kind, Key, Entry]]:
        """Iterates over all factors that hold now."""
        return ((kind, key, entry) for kind in KINDS for key, entry in self._held[kind].items())

    def hold(self, keyframes: int, kind: Kind, entries: dict[Key, Entry], gone: str) -> None:
        """Replaces the factors of a kind by `entries`, without those that are barred.

        New keys are logged as added, missing ones as withdrawn for the reason `gone`; known keys are updated.
        """
        before = self._held[kind]
        if self._barred:
            entries = {key: entry for key, entry in entries.items() if (kind, key) not in self._barred}
        for key in [key for key in before if key not in entries]:
            self.events.append(FactorEvent(keyframes, kind, key, "withdrawn", before[key].by, gone))
        for key, entry in entries.items():
            if key not in before:
                self.events.append(FactorEvent(keyframes, kind, key, "added", entry.by, entry.why))
        self._held[kind] = entries

    def add(self, keyframes: int, kind: Kind, key: Key, entry: Entry) -> None:
        """Adds a factor under a new key."""
        self._held[kind][key] = entry
        self.events.append(FactorEvent(keyframes, kind, key, "added", entry.by, entry.why))

    def withdraw(self, keyframes: int, kind: Kind, keys: list[Key], why: str, *, for_good: bool = False) -> None:
        """Removes factors; `for_good` bars their keys from being added again."""
        for key in keys:
            entry = self._held[kind].pop(key)
            what: Literal["barred", "withdrawn"] = "barred" if for_good else "withdrawn"
            self.events.append(FactorEvent(keyframes, kind, key, what, entry.by, why))
            _log.warning("factor %s %s, by %s, is %s: %s", kind, "/".join(map(str, key)), entry.by, what, why)
            if for_good:
                self._barred.add((kind, key))

    def refuse(self, keyframes: int, kind: Kind, key: Key, by: str, why: str) -> None:
        """Logs, once, a factor that could not be built."""
        if (kind, key) not in self._refused:
            self._refused.add((kind, key))
            self.events.append(FactorEvent(keyframes, kind, key, "refused", by, why))
            _log.warning("factor %s %s, by %s, is refused: %s", kind, "/".join(map(str, key)), by, why)

    def graph(self, of: Callable[[Kind, Key], bool] = lambda kind, key: True) -> gtsam.NonlinearFactorGraph:
        """Builds the factor graph of all factors that hold now, or of those that are chosen."""
        graph = gtsam.NonlinearFactorGraph()
        for kind, key, entry in self:
            if entry.factor is not None and of(kind, key):
                graph.add(entry.factor)
        return graph

    def unsound(self, values: gtsam.Values) -> Iterator[tuple[Kind, Key, str]]:
        """The factors with a non-finite error at `values`, each with the reason."""
        for kind, key, entry in self:
            try:
                error = 0.0 if entry.factor is None else entry.factor.error(values)
            except RuntimeError as refused:
                yield kind, key, f"GTSAM refuses it ({str(refused).strip().partition(chr(10))[0]})"
            else:
                if not np.isfinite(error):
                    yield kind, key, f"its error is {error}"

    def counts(self) -> dict[Kind, dict[str, int]]:
        """Counts of each kind: factors that hold, and those added, withdrawn, barred and refused so far."""
        none = {"added": 0, "withdrawn": 0, "barred": 0, "refused": 0}
        counted = {kind: {"held": len(self._held[kind]), **none} for kind in KINDS}
        for event in self.events:
            counted[event.kind][event.what] += 1
        return counted


def write_pose_graph(path: Path, log: FactorLog, poses: Floats) -> int:
    """Writes `VERTEX_SE3:QUAT` of the keyframes, `poses` (K, 4, 4), and `EDGE_SE3:QUAT` of the motions between them.

    Robust losses are left out, as are walls, rooms and the plan. Returns the number of edges.
    """
    lines = [f"VERTEX_SE3:QUAT {i} {_words(row)}" for i, row in enumerate(poses_to_xyzquat(poses))]
    motions = [entry.factor for _, _, entry in log if isinstance(entry.factor, gtsam.BetweenFactorPose3)]
    edges = [_edge(f) for f in motions if all(chr(gtsam.symbolChr(key)) == "x" for key in list(f.keys()))]
    write_atomically(path, "\n".join(lines + edges) + "\n")
    return len(edges)


def _edge(factor: gtsam.BetweenFactorPose3) -> str:
    first, second = (gtsam.symbolIndex(key) for key in list(factor.keys()))
    noise: Any = factor.noiseModel()
    if isinstance(noise, gtsam.noiseModel.Robust):
        noise = noise.noise()
    information = np.roll(noise.information(), 3, axis=(0, 1)) * np.outer(_UNITS, _UNITS)
    motion = poses_to_xyzquat(factor.measured().matrix())
    return f"EDGE_SE3:QUAT {first} {second} {_words(motion)} {_words(information[np.triu_indices(6)])}"


def _words(numbers: Floats) -> str:
    return " ".join(f"{number:.15g}" for number in numbers.tolist())
