"""The back end's log: which factors hold now, and of each who added it, when and why, and what became of it."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import gtsam
import numpy as np

Kind = Literal["start", "odometry", "wall", "floor", "room", "loop", "anchor"]
Key = tuple[int | str, ...]
KINDS: tuple[Kind, ...] = ("start", "odometry", "wall", "floor", "room", "loop", "anchor")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """A factor, `by` whom (odometry, a match, ...) and `why` it is held."""

    factor: gtsam.NonlinearFactor
    by: str
    why: str


@dataclass(frozen=True)
class FactorEvent:
    """What became of a factor when so many keyframes were known; `key` names it among those of its kind."""

    keyframes: int
    kind: Kind
    key: Key
    what: Literal["added", "withdrawn", "barred", "refused"]
    by: str
    why: str


class FactorLog:
    """All factors in the order in which they came, by kind, so that the same log always gives the same graph."""

    def __init__(self) -> None:
        self._held: dict[Kind, dict[Key, Entry]] = {kind: {} for kind in KINDS}
        self._barred: set[tuple[Kind, Key]] = set()
        self._refused: set[tuple[Kind, Key]] = set()
        self.events: list[FactorEvent] = []

    def state(self) -> dict[str, Any]:
        """What was held, barred, refused and told, as a tree; the factors themselves are made anew for `restore`."""
        keys = {kind: list(entries) for kind, entries in self._held.items()}
        return {"held": keys, "barred": self._barred, "refused": self._refused, "events": self.events}

    def restore(self, state: dict[str, Any], made: "FactorLog") -> None:
        """Goes on from what `state` told, with the factors of a log into which they were `made` anew.

        Raises ValueError where one is missing there.
        """
        for kind in KINDS:
            factors = made.held(kind)
            if missing := [key for key in state["held"][kind] if key not in factors]:
                raise ValueError(f"factor {kind} {missing[0]} cannot be made anew")
            self._held[kind] = {key: factors[key] for key in state["held"][kind]}
        self._barred, self._refused, self.events = state["barred"], state["refused"], state["events"]

    def held(self, kind: Kind) -> dict[Key, Entry]:
        """The factors of a kind that hold now, by key."""
        return self._held[kind]

    def __iter__(self) -> Iterator[tuple[Kind, Key, Entry]]:
        """All that hold now."""
        return ((kind, key, entry) for kind in KINDS for key, entry in self._held[kind].items())

    def hold(self, keyframes: int, kind: Kind, entries: dict[Key, Entry], gone: str) -> None:
        """These factors of a kind hold from now on: new ones are added, those that are missing withdrawn because they
        are `gone`, those of a known key replaced. What was barred stays out."""
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
        """One more factor, under a key that is new."""
        self._held[kind][key] = entry
        self.events.append(FactorEvent(keyframes, kind, key, "added", entry.by, entry.why))

    def withdraw(self, keyframes: int, kind: Kind, keys: list[Key], why: str, *, for_good: bool = False) -> None:
        """Takes factors out; `for_good`: they are barred, and do not come back under the same key."""
        for key in keys:
            entry = self._held[kind].pop(key)
            what: Literal["barred", "withdrawn"] = "barred" if for_good else "withdrawn"
            self.events.append(FactorEvent(keyframes, kind, key, what, entry.by, why))
            _log.warning("factor %s %s, by %s, is %s: %s", kind, "/".join(map(str, key)), entry.by, what, why)
            if for_good:
                self._barred.add((kind, key))

    def refuse(self, keyframes: int, kind: Kind, key: Key, by: str, why: str) -> None:
        """Takes note, once, of a factor that could not be made."""
        if (kind, key) not in self._refused:
            self._refused.add((kind, key))
            self.events.append(FactorEvent(keyframes, kind, key, "refused", by, why))
            _log.warning("factor %s %s, by %s, is refused: %s", kind, "/".join(map(str, key)), by, why)

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """The factor graph of all that hold now, built anew."""
        graph = gtsam.NonlinearFactorGraph()
        for _, _, entry in self:
            graph.add(entry.factor)
        return graph

    def unsound(self, values: gtsam.Values) -> Iterator[tuple[Kind, Key, str]]:
        """The factors whose error at `values` is no finite number, and why."""
        for kind, key, entry in self:
            try:
                error = entry.factor.error(values)
            except RuntimeError as refused:
                yield kind, key, f"GTSAM refuses it ({str(refused).strip().partition(chr(10))[0]})"
            else:
                if not np.isfinite(error):
                    yield kind, key, f"its error is {error}"

    def counts(self) -> dict[Kind, dict[str, int]]:
        """How many factors of each kind hold, and how many were added, withdrawn, barred and refused so far."""
        none = {"added": 0, "withdrawn": 0, "barred": 0, "refused": 0}
        counted = {kind: {"held": len(self._held[kind]), **none} for kind in KINDS}
        for event in self.events:
            counted[event.kind][event.what] += 1
        return counted
