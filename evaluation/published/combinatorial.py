"""Our build of iS-Graphs' search beside what was measured on its public code.

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
        description="iS-Graphs' search: what it answers, how long it takes.",
    )
    parser.add_argument("--limit", type=float, default=60.0, metavar="S", help="seconds an answer (default 60)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="a page whose section 'combinatorial' is written too")
    options = parser.parse_args(arguments)
    if not options.limit > 0:
        raise UserError(f"--limit {options.limit:g}: must be more than 0")
    from evaluation.harness.benchmark_page import made_by, write_section
    from evaluation.published.combinatorial_behaviour import behaviour
    from evaluation.published.combinatorial_times import times
    from matching.combinatorial.search import CombinatorialMatcher
    from matching.combinatorial.settings import DEVELOP, GRID

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
    "`combinatorial` is iS-Graphs' search as its public code does it, `combinatorial-grid` its later branch. Both were "
    "asked what the public code had been asked on synthetic layouts of the same description: grids of rooms, uneven "
    "ones unless said otherwise, A rooms:S rooms, walls seen with 3 cm and 0.5° of noise. The public code breaks ties "
    "in random order; which of them is the first means nothing."
)
TIMES = (
    "Seconds for one answer, ours of one processor core (the limit is of the wall clock). The public code was measured "
    "on 2 cores; ours tries the same sets of pairs, thousands at once. At most {worst:.2f} times as long as the "
    "public code. Where one of the two was stopped, the time is a bound."
)

if __name__ == "__main__":
    run_command(main)
