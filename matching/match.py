"""`python -m matching.match`: matches an S-graph's file with an A-graph's."""

from pathlib import Path

from data.cli import Parser, run_command
from data.errors import UserError


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 whatever the answer's status is. Raises UserError."""
    parser = Parser(prog="python -m matching.match", description="Finds where a map lies in a building's plan.")
    parser.add_argument("--s-graph", type=Path, required=True, metavar="FILE", help="the map's scene graph, JSON")
    parser.add_argument("--a-graph", type=Path, required=True, metavar="FILE", help="the plan's scene graph, JSON")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where the answer is written, JSON")
    parser.add_argument("--method", default="learned", metavar="NAME", help="learned (default), voting, paper, ...")
    options = parser.parse_args(arguments)
    # imported here so that --help is fast
    from data.files import write_json
    from data.scene_graph import SceneGraph
    from matching.matcher import Matcher

    matcher = Matcher.load(options.method)
    if not options.out.parent.is_dir():
        raise UserError(f"{options.out.parent}: no such folder; give --out in one that exists")
    result = matcher.match(SceneGraph.load(options.s_graph), SceneGraph.load(options.a_graph))
    write_json(options.out, result.to_dict())
    print(f"{result.status}: {result.reason}")
    return 0


if __name__ == "__main__":
    run_command(main)
