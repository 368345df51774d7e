"""`python -m matching.match`: matches an S-graph with an A-graph, both read from files."""

from pathlib import Path
from typing import TYPE_CHECKING

from data.common.cli import Parser, run_command
from data.common.errors import UserError

if TYPE_CHECKING:
    from data.scene_graph import SceneGraph


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns 0 whatever the status of the match is. Raises UserError."""
    parser = Parser(prog="python -m matching.match", description="Find where a map is in a building's plan.")
    parser.add_argument("--s-graph", type=Path, required=True, metavar="FILE", help="scene graph of the map (JSON)")
    parser.add_argument("--a-graph", type=Path, required=True, metavar="FILE", help="scene graph of the plan (JSON)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file for the match (JSON)")
    parser.add_argument("--method", metavar="NAME", help="voting, learned, paper, ... (default: that of runs)")
    parser.add_argument("--floor", metavar="NAME", help="storey of the plan to search (default: all)")
    parser.add_argument("--map-floor", metavar="NAME", help="storey of the map to match; required if it has several")
    options = parser.parse_args(arguments)
    # imported here so that --help is fast
    from data.common.files import write_json
    from data.scene_graph import SceneGraph
    from matching.matcher import DEFAULT, Matcher

    matcher = Matcher.load(options.method or DEFAULT)
    if not options.out.parent.is_dir():
        raise UserError(f"{options.out.parent}: no such folder; give --out in one that exists")
    s, a = SceneGraph.load(options.s_graph), SceneGraph.load(options.a_graph)
    floor = None if options.floor is None else _floor(options.a_graph, a, options.floor, "--floor")
    if options.map_floor is not None or len(_floors(s)) > 1:
        s = s.on_floor(_floor(options.s_graph, s, options.map_floor, "--map-floor"))
    result = matcher.match(s, a, floor=floor)
    write_json(options.out, result.to_dict())
    print(f"{result.status}: {result.reason}")
    return 0


def _floor(path: Path, graph: "SceneGraph", wanted: str | None, option: str) -> str:
    """Returns the id of the floor with this id or name. Raises UserError unless there is exactly one."""
    known = _floors(graph)
    found = [floor for floor, name in known.items() if wanted is not None and wanted in (floor, name)]
    if len(found) == 1:
        return found[0]
    wrong = "has several storeys" if wanted is None else f"has no storey '{wanted}'"
    listed = ", ".join(f"{floor} ({name})" if name else floor for floor, name in known.items())
    raise UserError(f"{path}: {wrong}; give {option} with one of: {listed or 'none'}")


def _floors(graph: "SceneGraph") -> dict[str, str]:
    """Returns ids and names of all floors, including those that only rooms or surfaces refer to."""
    found = {f.id: f.name for f in graph.floors}
    for floor in (*(r.floor for r in graph.rooms), *(w.floor for w in graph.wall_surfaces)):
        if floor is not None:
            found.setdefault(floor, "")
    return found


if __name__ == "__main__":
    run_command(main)
