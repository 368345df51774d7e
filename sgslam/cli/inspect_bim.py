"""`python -m sgslam.cli.inspect_bim FILE --out DIR`: checks a building's plan before a robot drives through it.

Draws the A-graph, lists gaps in the plan and places that look alike, and predicts how many rooms a robot must see to
localise, for each start room.
"""

from data.common.cli import Parser, run_command
from data.common.processes import cores
from sgslam.cli.options import add_options, bounded

PAGE, VALUES = "inspection.html", "inspection.json"


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    options = _parser().parse_args(arguments)
    from rich.console import Console
    from rich.progress import Progress

    from data.common.files import write_atomically, write_json
    from data.plans import load_bim
    from matching.matcher import DEFAULT
    from sgslam.inspection import inspect
    from sgslam.inspection.page import inspection_html, key_figures
    from sgslam.result.saving import prepare_folder

    bim = load_bim(options.bim, layers=options.layer)
    out = prepare_folder(options.out)
    settings = {"method": options.method or DEFAULT, "maps": options.maps, "seed": options.seed}
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task("start rooms", total=None)
        found = inspect(
            bim.graph,
            bim.notices,
            **settings,
            jobs=options.jobs,
            progress=lambda done, of: bar.update(task, completed=done, total=of),
        )
    write_json(out / VALUES, {"file": options.bim.name, **settings, **found.to_dict()})
    write_atomically(out / PAGE, inspection_html(found, options.bim.name))
    for line in [*found.notices, *(issue.message for issue in found.issues)]:
        print(f"issue: {line}")
    for label, value in key_figures(found).items():
        print(f"{label}: {value}")
    print(f"page: {out / PAGE}")
    return 0


def _parser() -> Parser:
    about = "Check a plan: gaps, places that look alike, and the number of rooms needed to localise."
    parser = Parser(prog="python -m sgslam.cli.inspect_bim", description=about)
    out = {"required": True, "help": f"folder for {PAGE} and {VALUES}"}
    add_options(parser, "layer", bim={"flag": "bim"}, out=out, seed={"help": "random seed of the maps (default: 0)"})
    add = parser.add_argument
    add("--method", metavar="NAME", help="matching method (default: that of runs)")
    most = "maximum number of maps per set of rooms (default: 21)"
    add("--maps", type=bounded("--maps", int, 1), default=21, metavar="N", help=most)
    processes = "number of processes (default: one per core)"
    add("--jobs", type=bounded("--jobs", int, 1), default=cores(), metavar="N", help=processes)
    return parser


if __name__ == "__main__":
    run_command(main)
