"""The tables of the matching benchmark, made from its rows, in Markdown and LaTeX."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from evaluation.matching_benchmark import symmetries as matching_symmetries
from evaluation.matching_benchmark.cells import LARGE, SIZES, Measures, measure, size_of
from evaluation.matching_benchmark.gains import BASE, difference, gap_closed
from evaluation.matching_benchmark.rows import ORACLE, Row
from evaluation.metrics.bootstrap import Estimate

Cell = Callable[[Measures], str]
REGIME_ORDER = ("paper", "real", "drift", "mis_segmented", "heavy_drift", "negative", "sgslam")


@dataclass(frozen=True)
class Table:
    """A table of text cells with a title and an explanatory note."""

    title: str
    note: str
    header: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


def tables(rows: Sequence[Row]) -> list[Table]:
    """For each size of plan: wall F1 and answers by rooms seen, all measures by regime and method; symmetric plans."""
    found = []
    for group in SIZES:
        own = [r for r in rows if size_of(r.size) == group]
        if not own:
            continue
        about = f"{group} plans ({_about(own)})"
        to_find = [r for r in own if r.regime != "negative"]
        if to_find:
            found.append(_by_rooms(f"Wall F1, {about}", WALL_NOTE, to_find, lambda m: format_estimate(m.walls.f1)))
            found.append(_by_rooms(f"Room F1, {about}", WALL_NOTE, to_find, lambda m: format_estimate(m.rooms.f1)))
        asked = [r for r in own if r.method != ORACLE]
        if asked:
            found.append(_by_rooms(f"Unique answers, and the wrong of them, {about}", UNIQUE_NOTE, asked, _unique))
        found.append(_summary(f"All measures, {about}", own))
        known = [r for r in to_find if not r.twin]  # only the oracle can decide between alternative placements
        compared = [("on the same pairs", to_find), ("on the same pairs without an alternative placement", known)]
        for which, pairs in compared if len(known) < len(to_find) else compared[:1]:
            gains = _gains(f"Wall F1 against `{BASE}`'s {which}, {about}", pairs)
            found += [gains] if gains.lines else []
    twins = matching_symmetries.lines(rows)
    if twins:
        found.append(Table("Symmetric plans", matching_symmetries.NOTE, matching_symmetries.HEADER, tuple(twins)))
    return found


def full_tables(rows: Sequence[Row]) -> list[Table]:
    """Wall F1 on each set of plans, and all measures of every cell (size of plan, regime, method, rooms seen)."""
    found = []
    for name in sorted({r.plans for r in rows if r.regime != "negative"}):
        own = [r for r in rows if r.plans == name and r.regime != "negative"]
        sizes = sorted({(r.size, r.plan) for r in own})
        title = f"Wall F1, `{name}` ({len(sizes)} plans of {sizes[0][0]} to {sizes[-1][0]} rooms)"
        found.append(_by_rooms(title, WALL_NOTE, own, lambda m: format_estimate(m.walls.f1)))
    for group in SIZES:
        for regime in in_order(rows):
            own = [r for r in rows if size_of(r.size) == group and r.regime == regime]
            if own:
                keys = [(rooms, method) for rooms in _rooms(own) for method in _methods(own)]
                lines = []
                for rooms, method in keys:
                    cell = [r for r in own if r.rooms == rooms and r.method == method]
                    if cell:
                        lines.append((_named(rooms), method, *_all_measures(measure(cell))))
                title = f"`{regime}`, {group} plans ({_about(own)})"
                found.append(Table(title, SUMMARY_NOTE, ("rooms", "method", *COLUMNS), tuple(lines)))
    return found


def markdown(table: Table) -> str:
    """The table in Markdown, with its title and note."""
    head = f"**{table.title}.** {table.note}\n\n| {' | '.join(table.header)} |\n|{'---|' * len(table.header)}\n"
    return head + "".join(f"| {' | '.join(line)} |\n" for line in table.lines)


def latex(table: Table) -> str:
    """The table in LaTeX, as wide as the text; needs the packages booktabs and graphicx."""
    columns = "ll" + "r" * (len(table.header) - 2)
    body = "".join(f"  {' & '.join(map(_escaped, line))} \\\\\n" for line in table.lines)
    return (
        "\\begin{table}\n  \\centering\n"
        f"  \\caption{{{_escaped(table.title)}. {_escaped(table.note)}}}\n"
        f"  \\resizebox{{\\textwidth}}{{!}}{{\\begin{{tabular}}{{{columns}}}\n  \\toprule\n"
        f"  {' & '.join(map(_escaped, table.header))} \\\\\n  \\midrule\n{body}"
        "  \\bottomrule\n  \\end{tabular}}\n\\end{table}\n"
    )


def format_estimate(estimate: Estimate | None, percent: bool = False) -> str:
    """Formats a value with its interval; empty for None."""
    if estimate is None:
        return ""
    if percent:
        return f"{100 * estimate.value:.0f} [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"
    return f"{estimate.value:.3f} [{estimate.low:.2f}, {estimate.high:.2f}]"


WALL_NOTE = (
    "Mean over pairs, whatever the answer's status, with its 95 % interval (bootstrap over buildings), by the number "
    "of rooms seen"
)
UNIQUE_NOTE = "Share of `unique` answers in percent, and how many of them are wrong, by the number of rooms seen"
SUMMARY_NOTE = (
    "P, R, F1: means over pairs; micro: over all nodes; acc: S nodes with a correct answer; shares in percent; "
    "decided: `unique` among pairs without an alternative placement; wrong: of the `unique`, with the share's 97.5 % "
    "upper bound; ECE: expected calibration error of the confidences"
)
GAIN_NOTE = (
    "Difference of the means with its 95 % interval (bootstrap over buildings); how much of the gap between the oracle "
    "and `voting` it closes, where that is 0.02 or more; in brackets the pairs"
)
COLUMNS = (
    "pairs", "walls P", "R", "F1", "micro F1", "acc", "rooms P", "R", "F1", "micro F1", "acc", "perfect", "unique",
    "ambiguous", "none", "decided", "wrong", "ECE walls", "ECE rooms", "median s", "95 % s", "in time",
)  # fmt: skip


def _all_measures(m: Measures) -> tuple[str, ...]:
    nodes = []
    for n in (m.walls, m.rooms):
        nodes += [format_estimate(value) for value in (n.precision, n.recall, n.f1)]
        nodes += [_value(n.micro_f1), format_estimate(n.accuracy)]
    shares = (m.perfect, m.unique, m.ambiguous, m.none, m.decided)
    bound = f" (≤ {100 * m.wrong_bound:.1f} %)" if m.uniques else ""
    failed = f", {m.failed} failed" if m.failed else ""
    errors = ("" if e is None else f"{e:.3f}" for e in (m.walls.calibration_error, m.rooms.calibration_error))
    return (
        str(m.pairs), *nodes, *(format_estimate(s, percent=True) for s in shares),
        f"{m.wrong} of {m.uniques}{bound}", *errors, f"{m.median_s:.3f}", f"{m.slow_s:.3f}",
        f"{100 * m.completed:.0f} %{failed}",
    )  # fmt: skip


def _value(estimate: Estimate | None) -> str:
    return "" if estimate is None else f"{estimate.value:.3f}"


def _unique(m: Measures) -> str:
    return "" if m.unique is None else f"{100 * m.unique.value:.0f} % · {m.wrong}/{m.uniques}"


def _by_rooms(title: str, note: str, rows: Sequence[Row], cell: Cell) -> Table:
    columns = _rooms(rows)
    lines = []
    for regime in in_order(rows):
        for method in _methods(rows):
            own = [r for r in rows if (r.regime, r.method) == (regime, method)]
            cells = [[r for r in own if r.rooms == rooms] for rooms in columns]
            if own:
                counts = sorted({len(c) for c in cells if c})
                pairs = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
                lines.append((regime, method, *(cell(measure(c)) if c else "" for c in cells), pairs))
    header = ("regime", "method", *map(_named, columns), "pairs a cell")
    return Table(title, note, header, tuple(lines))


def _summary(title: str, rows: Sequence[Row]) -> Table:
    lines = []
    for regime in in_order(rows):
        for method in _methods(rows):
            own = [r for r in rows if (r.regime, r.method) == (regime, method)]
            if own:
                lines.append((regime, method, *_all_measures(measure(own))))
    return Table(title, SUMMARY_NOTE, ("regime", "method", *COLUMNS), tuple(lines))


def _gains(title: str, rows: Sequence[Row]) -> Table:
    columns = _rooms(rows)
    lines = []
    for regime in in_order(rows):
        for method in _methods(rows):
            if method not in (BASE, ORACLE):
                own = [[r for r in rows if r.regime == regime and r.rooms == rooms] for rooms in columns]
                cells = [_gain(cell, method) for cell in own]
                lines += [(regime, method, *cells)] if any(cells) else []
    return Table(title, GAIN_NOTE, ("regime", "method", *map(_named, columns)), tuple(lines))


def _gain(rows: Sequence[Row], method: str) -> str:
    found, closed = difference(rows, method, BASE), gap_closed(rows, method)
    if found is None:
        return ""
    (value, pairs), share = found, "" if closed is None else f" · {100 * closed:.0f} %"
    return f"{value.value:+.3f} [{value.low:+.3f}, {value.high:+.3f}]{share} ({pairs})"


def _about(rows: Sequence[Row]) -> str:
    plans = {(r.plans, r.plan): r for r in rows}
    names = sorted({r.plans for r in rows})
    sizes = sorted(r.size for r in plans.values())
    edge = f"below {LARGE} rooms" if size_of(rows[0].size) == "small" else f"{LARGE} rooms and more"
    return f"{edge}: {len(plans)} of {', '.join(names)}, {sizes[0]} to {sizes[-1]} rooms"


def in_order(rows: Sequence[Row]) -> list[str]:
    """The regimes of the rows, easy ones first."""
    return sorted({r.regime for r in rows}, key=REGIME_ORDER.index)


def _methods(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(r.method for r in rows))


def _rooms(rows: Sequence[Row]) -> list[int | None]:
    return sorted({r.rooms for r in rows}, key=lambda n: float("inf") if n is None else n)


def _named(rooms: int | None) -> str:
    return "all" if rooms is None else str(rooms)


def _escaped(text: str) -> str:
    for mark in "&%_#":
        text = text.replace(mark, f"\\{mark}")
    return text.replace("≤", "$\\leq$").replace("·", "$\\cdot$").replace("`", "")
