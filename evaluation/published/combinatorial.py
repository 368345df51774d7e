"""Our implementation of iS-Graphs' search against measurements of its public code.

python -m evaluation.published.combinatorial
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Raises UserError."""
    parser = Parser(
        prog="python -m evaluation.published.combinatorial",
        description="Measure answers and times of iS-Graphs' search.",
    )
    parser.add_argument("--limit", type=float, default=60.0, metavar="S", help="time limit per answer (default 60)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page of results; its section is written")
    options = parser.parse_args(arguments)
    if not options.limit > 0:
        raise UserError(f"--limit {options.limit:g}: must be more than 0")
    from evaluation.harness.benchmark_page import made_by, write_section
    from evaluation.published.combinatorial_behaviour import behaviour
    from evaluation.published.combinatorial_times import times
    from matching.combinatorial import DEVELOP, GRID, CombinatorialMatcher

    released, later = (CombinatorialMatcher(replace(x, limit_s=options.limit)).match for x in (DEVELOP, GRID))
    answers = behaviour(released, later)
    print(answers)
    took, worst = times(released, later, options.limit)
    command = f"python -m evaluation.published.combinatorial --limit {options.limit:g}"
    text = f"{HEAD}\n\n{answers}\n{TIMES.format(worst=worst)}\n\n{took}\n{made_by(command)}\n"
    if options.page is not None:
        write_section(options.page, "combinatorial", text)
    print(text)
    return 0


HEAD = (
    "## The combinatorial search\n\n"
    "`combinatorial` is iS-Graphs' search as in its public code, `combinatorial-grid` its later branch. Both were run "
    "on synthetic layouts of the same description as the public code: grids of rooms, uneven unless stated otherwise, "
    "A rooms:S rooms, walls with 3 cm and 0.5° of noise. The public code breaks ties in random order, so which answer "
    "comes first has no meaning."
)
TIMES = (
    "Seconds for one answer, ours in CPU time of one core (the limit is in wall-clock time). The public code was "
    "measured on 2 cores; ours tries the same sets of pairs, thousands at once. Ours takes at most {worst:.2f} times "
    "as long as the public code. Where one of the two was stopped, the time is a bound."
)

if __name__ == "__main__":
    run_command(main)
