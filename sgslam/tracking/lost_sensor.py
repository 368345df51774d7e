"""Whether a sensor that was lost is still near the place where it was lost."""

from collections.abc import Callable
from typing import Any

from sgslam.config import TrackingSettings
from sgslam.odometry.timed import TimedOdometry
from sgslam.serialization import Stateful
from sgslam.types import RawScan


class LostSensor(Stateful):
    """The sensor is tracked; lost, while no scan fits the map; or unconfirmed, for some time after it was lost for
    longer and found again: it may be in a place that looks alike.

    Lost scans are registered with one another. If they fit for some time, and not the map near the place where the
    sensor was lost, it was carried elsewhere. So it counts where nothing was seen of its way for long, which is no
    different.
    """

    _STATE = ("_seen_ns", "_lost_ns", "_other_ns", "_found_ns", "_again_ns")

    def __init__(self, settings: TrackingSettings, make: Callable[[], TimedOdometry]) -> None:
        """`make` makes an odometry that knows of no scan yet."""
        self._settings, self._make = settings, make
        self._seen_ns: int | None = None  # the newest scan that was not lost
        self._lost_ns: int | None = None  # the first of the newest lost scans, or the last one before a pause
        self._other: TimedOdometry | None = None  # registers lost scans with one another
        self._other_ns = 0  # the first of them
        self._found_ns: int | None = None  # the first scan from where the sensor was found again
        self._again_ns: int | None = None  # when it was found, for the last time

    def see(self, stamp_ns: int, is_after_pause: bool) -> tuple[bool, int | None]:
        """Takes a scan that fits the map: whether it is unconfirmed, and since when the sensor is elsewhere (None if it
        is not)."""
        settings = self._settings
        if is_after_pause and self._lost_ns is None:
            self._lost_ns = self._seen_ns
        is_unseen = self._is_unseen(stamp_ns)
        self._other, self._seen_ns = None, stamp_ns
        if self._lost_ns is not None and stamp_ns - self._lost_ns >= 1e9 * settings.kidnapped:
            self._again_ns, self._found_ns = stamp_ns, stamp_ns if self._found_ns is None else self._found_ns
        elif self._again_ns is not None and stamp_ns - self._again_ns > 1e9 * settings.unconfirmed:
            self._again_ns, self._found_ns = None, None
        self._lost_ns = None
        since_ns = stamp_ns if self._found_ns is None else self._found_ns
        return self._again_ns is not None, since_ns if is_unseen else None

    def lose(self, scan: RawScan, is_after_pause: bool, odometry: TimedOdometry) -> int | None:
        """Takes a scan that does not fit the map of the run's `odometry`: since when the sensor is elsewhere, as in
        `see`."""
        stamp_ns = scan.stamp_ns
        if self._lost_ns is None:
            self._lost_ns = self._seen_ns if is_after_pause and self._seen_ns is not None else stamp_ns
        if self._other is None:
            self._other, self._other_ns = self._make(), stamp_ns
        if self._other.register(stamp_ns, scan.points, scan.point_times).health == "lost":
            self._other = None
            return None
        if stamp_ns - self._other_ns < 1e9 * self._settings.kidnapped:
            return None
        found_ns = self._other_ns if self._found_ns is None else self._found_ns
        if self._is_unseen(self._other_ns) or not odometry.rejoin(self._other):
            return found_ns
        self._found_ns, self._other = found_ns, None
        return None

    def _is_unseen(self, stamp_ns: int) -> bool:
        """Whether the sensor was lost for so long that it may be in another room by now, which looks the same."""
        return self._lost_ns is not None and stamp_ns - self._lost_ns >= 1e9 * self._settings.unseen

    def state(self) -> dict[str, Any]:
        """See `Stateful`."""
        return {**super().state(), "other": None if self._other is None else self._other.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._other = None
        if state["other"] is not None:
            self._other = self._make()
            self._other.restore(state["other"])
