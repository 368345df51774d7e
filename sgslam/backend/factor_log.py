"""The factor log: all factors that hold now, and every event of a factor with its time, origin and reason."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
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
    what: Literal["added", "withdrawn"]
    by: str
    why: str


class FactorLog:
    """All factors by kind in the order in which they were added, so that equal logs give equal graphs."""

    def __init__(self) -> None:
        self._held: dict[Kind, dict[Key, Entry]] = {kind: {} for kind in KINDS}
        self.events: list[FactorEvent] = []

    def __getstate__(self) -> dict[str, Any]:
        """The log without the factors themselves."""
        held = {
            kind: {key: replace(entry, factor=None) for key, entry in entries.items()}
            for kind, entries in self._held.items()
        }
        return {"_held": held, "events": self.events}

    def held(self, kind: Kind) -> dict[Key, Entry]:
        """The factors of a kind that hold now, by key."""
        return self._held[kind]

    def __iter__(self) -> Iterator[tuple[Kind, Key, Entry]]:
        """Iterates over all factors that hold now."""
        return ((kind, key, entry) for kind in KINDS for key, entry in self._held[kind].items())

    def hold(self, keyframes: int, kind: Kind, entries: dict[Key, Entry], gone: str) -> None:
        """Replaces the factors of a kind by `entries`.

        New keys are logged as added, missing ones as withdrawn for the reason `gone`; known keys are updated.
        """
        before = self._held[kind]
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

    def graph(self, of: Callable[[Kind, Key], bool] = lambda kind, key: True) -> gtsam.NonlinearFactorGraph:
        """Builds the factor graph of all factors that hold now, or of those that are chosen."""
        graph = gtsam.NonlinearFactorGraph()
        for kind, key, entry in self:
            if entry.factor is not None and of(kind, key):
                graph.add(entry.factor)
        return graph


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
