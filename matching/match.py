"""`python -m matching.match`: matches an S-graph's file with an A-graph's."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from data.errors import UserError


def main(
    s_graph: Annotated[Path, typer.Option(help="The map's scene graph, JSON.")],
    a_graph: Annotated[Path, typer.Option(help="The plan's scene graph, JSON.")],
    out: Annotated[Path, typer.Option(help="Where the answer is written, JSON.")],
    method: Annotated[str, typer.Option(help="The matcher: voting.")] = "voting",
) -> None:
    """Finds where a map lies in a building's plan."""
    # Imported here so that --help is fast.
    from data.files import write_json
    from data.scene_graph import SceneGraph
    from matching.matcher import Matcher

    try:
        matcher = Matcher.load(method)
        result = matcher.match(SceneGraph.load(s_graph), SceneGraph.load(a_graph))
        if not out.parent.is_dir():
            raise UserError(f"{out.parent}: no such folder; give --out in one that exists")
        write_json(out, result.to_dict())
    except UserError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(2) from None
    print(f"{result.status}: {result.reason}")


if __name__ == "__main__":
    typer.run(main)
