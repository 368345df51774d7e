"""The log of all anchors: what added each one, when and why, and every later change of its state."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

State = Literal["tight", "loose", "withdrawn"]
Key = tuple[int, str]  # wall, A surface
_log = logging.getLogger(__name__)


class AnchorStatus(NamedTuple):
    """The present state of an anchor, the match that placed the map, and the reason."""

    state: State
    by: str
    why: str


@dataclass(frozen=True)
class AnchorEvent:
    """A change of an anchor's state, at the stamp (ns) of the newest keyframe, and its reason."""

    stamp_ns: int
    state: State
    why: str


@dataclass(frozen=True)
class AnchorRecord:
    """A wall anchored to a planned surface; `by` is the match that placed the map."""

    wall: int
    a_id: str
    by: str
    events: tuple[AnchorEvent, ...] = ()

    @property
    def state(self) -> State:
        """The newest state."""
        return self.events[-1].state

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values and the newest state; the wall is named by its id in the S-graph."""
        events = [asdict(event) for event in self.events]
        return {"wall": f"w{self.wall}", "a_id": self.a_id, "by": self.by, "state": self.state, "events": events}


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

    def update(
        self,
        stamp_ns: int,
        anchors: Mapping[Key, AnchorStatus],
        why_gone: str = "the wall is no longer seen at the planned one",
    ) -> None:
        """Records all anchors that hold now; the others are withdrawn."""
        gone = {
            key: AnchorStatus("withdrawn", r.by, why_gone) for key, r in self._records.items() if key not in anchors
        }
        for key, now in [*sorted(anchors.items()), *gone.items()]:
            record = self._records.get(key) or AnchorRecord(*key, now.by)
            if not record.events or record.state != now.state:
                event = AnchorEvent(stamp_ns, now.state, now.why)
                self._records[key] = replace(record, events=(*record.events, event))
                _log.info("anchor w%d to %s, by %s: %s, %s", *key, now.by, now.state, now.why)
