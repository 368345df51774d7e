"""`python -m sgslam.cli.inspect_bim FILE --out DIR`: checks a building's plan before a robot drives through it.

Draws the A-graph, lists gaps in the plan and places that look alike, and predicts how many rooms a robot must see to
localise, for each start room.
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
        raise UserError("--maps and --jobs: must be 1 or more")
    from data.common.files import write_atomically, write_json
    from data.plans import load_bim
    from sgslam.inspection import InspectionSettings, inspect
    from sgslam.inspection.page import inspection_html
    from sgslam.session.result import prepare_folder

    bim = load_bim(options.bim, layers=options.layer)
    out = prepare_folder(options.out)
    with _progress() as update:
        settings = InspectionSettings(options.method, options.maps, options.seed)
        found = inspect(bim.graph, bim.notices, settings, options.jobs, update)
    write_json(out / VALUES, {"file": options.bim.name, **_settings(options), **found.to_dict()})
    write_atomically(out / PAGE, inspection_html(found, options.bim.name))
    for line in [*found.notices, *(issue.message for issue in found.issues)]:
        print(f"issue: {line}")
    outside = sum(found.counts(floor.id)["walls_without_room"] for floor in found.graph.floors)
    print(f"walls and columns that bound no room: {outside:,}")
    needed = [r.to_localise for r in found.rooms.values()]
    never, lost = (sum(n.outcome == outcome for n in needed) for outcome in ("never", "not found"))
    known = sorted(n.rooms for n in needed if n.rooms is not None)
    if known:
        needs = f"median {known[len(known) // 2]}, maximum {known[-1]}"
        print(f"rooms needed to localise, over {len(known)} start rooms: {needs}")
    if never or lost:
        print(f"never localised: {never} start rooms because of the building's symmetry, {lost} not matched")
    print(f"page: {out / PAGE}")
    return 0


def _parser() -> Parser:
    about = "Check a plan: gaps, places that look alike, and the number of rooms needed to localise."
    parser = Parser(prog="python -m sgslam.cli.inspect_bim", description=about)
    add = parser.add_argument
    add("bim", type=Path, metavar="FILE", help="the building: .ifc, .ifczip, .dxf, .geojson, or an A-graph as .json")
    add("--out", type=Path, required=True, metavar="DIR", help=f"folder for {PAGE} and {VALUES}")
    add("--layer", action="append", default=[], metavar="NAME", help="wall layer of a .dxf file (repeatable)")
    add("--method", default="learned", metavar="NAME", help="matching method (default: learned)")
    add("--maps", type=int, default=21, metavar="N", help="maximum number of maps per set of rooms (default: 21)")
    add("--seed", type=int, default=0, metavar="N", help="random seed of the maps (default: 0)")
    add("--jobs", type=int, default=cores(), metavar="N", help="number of processes (default: one per core)")
    return parser


def _settings(options: Namespace) -> dict[str, str | int]:
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
