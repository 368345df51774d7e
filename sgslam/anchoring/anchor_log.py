"""The log of all anchors: what added each one, when and why, and every later change of its state."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

State = Literal["tight", "loose", "withdrawn"]
Key = tuple[int, str]  # wall, A surface
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class AnchorEvent:
    """A change of an anchor's state, at the stamp (ns) of the newest keyframe, and its reason."""

    stamp_ns: int
    state: State
    why: str


@dataclass(frozen=True)
class AnchorRecord:
    """A wall anchored to a planned surface; `by` is what paired them: a match or their position."""

    wall: int
    a_id: str
    by: str
    events: tuple[AnchorEvent, ...]

    @property
    def state(self) -> State:
        """The newest state."""
        return self.events[-1].state

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values and the newest state; the wall is named by its id in the S-graph."""
        events = [asdict(event) for event in self.events]
        return {"wall": f"w{self.wall}", "a_id": self.a_id, "by": self.by, "state": self.state, "events": events}


@dataclass(frozen=True)
class AnchorStatus:
    """The present state of an anchor, what paired it, and the reason."""

    state: State
    by: str
    why: str


class AnchorLog:
    """The records of a run, in the order in which the anchors were added."""

    def __init__(self) -> None:
        self._records: dict[Key, AnchorRecord] = {}

    @property
    def records(self) -> tuple[AnchorRecord, ...]:
        """All records, those of withdrawn anchors included."""
        return tuple(self._records.values())

    def rename(self, current: Callable[[int], int]) -> None:
        """Follows walls that were joined; `current` gives a wall's number now. Of two records the older one stays."""
        renamed: dict[Key, AnchorRecord] = {}
        for (wall, a_id), record in self._records.items():
            renamed.setdefault((current(wall), a_id), replace(record, wall=current(wall)))
        self._records = renamed

    def update(self, stamp_ns: int, anchors: dict[Key, AnchorStatus]) -> None:
        """Records all anchors that hold now; the others are withdrawn."""
        for key, now in sorted(anchors.items()):
            self._record(stamp_ns, key, now)
        gone = [key for key, r in self._records.items() if key not in anchors and r.state != "withdrawn"]
        self._withdraw(stamp_ns, gone, "the wall is no longer seen at the planned one")

    def withdraw_all(self, stamp_ns: int, why: str) -> None:
        """Withdraws all anchors."""
        self._withdraw(stamp_ns, [key for key, r in self._records.items() if r.state != "withdrawn"], why)

    def _withdraw(self, stamp_ns: int, keys: Iterable[Key], why: str) -> None:
        for key in keys:
            self._record(stamp_ns, key, AnchorStatus("withdrawn", self._records[key].by, why))

    def _record(self, stamp_ns: int, key: Key, now: AnchorStatus) -> None:
        record = self._records.get(key)
        if record is not None and record.state == now.state:
            return
        event = AnchorEvent(stamp_ns, now.state, now.why)
        if record is None:
            self._records[key] = AnchorRecord(*key, now.by, (event,))
        else:
            self._records[key] = replace(record, events=(*record.events, event))
        _log.info("anchor w%d to %s, by %s: %s, %s", *key, now.by, now.state, now.why)
