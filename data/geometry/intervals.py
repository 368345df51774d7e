"""Sets of points on a line, as sorted lists of intervals that do not touch."""

Intervals = list[tuple[float, float]]
SLIVER = 1e-4  # shorter intervals are numerical dust


def united(intervals: Intervals, gap: float = 0.0) -> Intervals:
    """The union; intervals at most `gap` apart are joined over it."""
    result: Intervals = []
    for low, high in sorted(intervals):
        if result and low <= result[-1][1] + gap:
            result[-1] = (result[-1][0], max(high, result[-1][1]))
        else:
            result.append((low, high))
    return result


def common(a: Intervals, b: Intervals) -> Intervals:
    """The intersection."""
    parts = [(max(p[0], q[0]), min(p[1], q[1])) for p in a for q in b]
    return united([p for p in parts if p[1] - p[0] > SLIVER])


def without(a: Intervals, b: Intervals) -> Intervals:
    """What of `a` is not in `b`."""
    for low, high in b:
        parts = [part for p in a for part in ((p[0], min(p[1], low)), (max(p[0], high), p[1]))]
        a = [p for p in parts if p[1] - p[0] > SLIVER]
    return a
