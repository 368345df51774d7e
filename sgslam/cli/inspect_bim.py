"""`python -m sgslam.cli.inspect_bim FILE --out DIR`: a building's plan looked at before any robot drives.

Its A-graph drawn, what it lacks, where it is its own twin, and how many rooms a robot must see from each room on
before it can know where it is.
"""

from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.processes import cores

PAGE, VALUES = "inspection.html", "inspection.json"


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    options = _parser().parse_args(arguments)
    if options.maps < 1 or options.jobs < 1:
        raise UserError("--maps and --jobs: 1 or more")
    from data.common.files import write_atomically, write_json
    from data.plans.bim import load_bim
    from sgslam.inspection.inspection import InspectionSettings, inspect
    from sgslam.inspection.page import inspection_html
    from sgslam.session.result import prepare_folder

    bim = load_bim(options.bim, layers=options.layer)
    out = prepare_folder(options.out)
    with _progress() as tell:
        settings = InspectionSettings(options.method, options.maps, options.seed)
        found = inspect(bim.graph, bim.notices, settings, options.jobs, tell)
    write_json(out / VALUES, {"file": options.bim.name, **_asked(options), **found.to_dict()})
    write_atomically(out / PAGE, inspection_html(found, options.bim.name))
    for line in [*found.notices, *(issue.message for issue in found.issues)]:
        print(f"lacks: {line}")
    needed = [r.to_localise for r in found.rooms.values()]
    never, lost = (sum(n.outcome == outcome for n in needed) for outcome in ("never", "not found"))
    known = sorted(n.rooms for n in needed if n.rooms is not None)
    if known:
        told = f"{known[len(known) // 2]} in the median, {known[-1]} at the most"
        print(f"rooms to be seen before the place is known, from {len(known)} start rooms: {told}")
    if never or lost:
        print(f"from {never} start rooms it is never known since the building is its own twin; from {lost} not found")
    print(f"page: {out / PAGE}")
    return 0


def _parser() -> Parser:
    about = "What a plan lacks, where it is its own twin, and how many rooms must be seen to know the place."
    parser = Parser(prog="python -m sgslam.cli.inspect_bim", description=about)
    add = parser.add_argument
    add("bim", type=Path, metavar="FILE", help="the building: .ifc, .ifczip, .dxf, .geojson, or an A-graph as .json")
    add("--out", type=Path, required=True, metavar="DIR", help=f"for {PAGE} and {VALUES}")
    add("--layer", action="append", default=[], metavar="NAME", help="a layer of a .dxf with walls; may be given again")
    add("--method", default="learned", metavar="NAME", help="the matcher that is asked (default: learned)")
    add("--maps", type=int, default=21, metavar="N", help="maps of the same rooms, at most (default 21)")
    add("--seed", type=int, default=0, metavar="N", help="of the maps")
    add("--jobs", type=int, default=cores(), metavar="N", help="processes (default: one a core)")
    return parser


def _asked(options: Namespace) -> dict[str, str | int]:
    return {"method": options.method, "maps": options.maps, "seed": options.seed}


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task("start rooms", total=None)
        yield lambda done, of: progress.update(task, completed=done, total=of)


if __name__ == "__main__":
    run_command(main)
