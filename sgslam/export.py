"""`python -m sgslam.export --out OUT --bim FILE.ifc`: what a finished run found of the building, for BIM viewers.

Writes into the run's folder `as_built.ifc`, a copy of the model whose walls tell how they were built (property set
`AsBuilt`, and colours), and `deviations.bcf`, a topic for each wall that stands otherwise than planned.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data.cli import Parser, run_command
from data.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from data.scene_graph import SceneGraph

IFC, BCF = "as_built.ifc", "deviations.bcf"


def export(out: Path, bim: Path, ifc: bool = True, bcf: bool = True) -> list[str]:
    """Writes what is asked for, and returns a line on each file.

    Raises UserError for a folder that is no run's, a run that was not anchored, a model that cannot be read, and one
    of whose walls the run knows none.
    """
    from data.bcf import Model
    from data.ifc_deviations import project_of, write_as_built
    from sgslam.findings import unplanned_walls, wall_findings, write_topics

    deviations, a_graph, s_graph, T_bim_map, storey = _read(out)
    lines = []
    if ifc:
        findings = wall_findings(deviations, a_graph)
        unplanned = unplanned_walls(deviations, s_graph, T_bim_map, storey)
        marked = write_as_built(bim, findings, unplanned, out / IFC)
        if findings and not marked:
            (out / IFC).unlink()
            raise UserError(f"{bim}: has none of the walls that {out} knows; give the model of that run")
        lines.append(f"{out / IFC}: {marked} walls with the property set AsBuilt, {len(unplanned)} unplanned added")
    if bcf:
        count = write_topics(
            out / BCF, deviations, a_graph, s_graph, T_bim_map, Model(bim.name, project_of(bim))
        )  # fmt: skip
        lines.append(f"{out / BCF}: {count} topics")
    return lines


def _read(
    out: Path,
) -> "tuple[list[dict[str, Any]], SceneGraph, SceneGraph, NDArray[np.float64], str | None]":
    """Of a run's folder: deviations, A-graph, S-graph, T_bim_map (4, 4), and the storey's id."""
    import numpy as np

    from data.poses import xyzquat_to_poses
    from data.scene_graph import SceneGraph

    try:
        deviations, metrics, matches = (
            json.loads((out / f"{name}.json").read_text()) for name in ("deviations", "metrics", "matches")
        )
    except (OSError, json.JSONDecodeError):
        what = "deviations.json, metrics.json, matches.json"
        raise UserError(f"{out}: no run's folder ({what}); give a run's --out") from None
    if metrics.get("T_bim_map") is None:
        raise UserError(f"{out}: that run was not anchored, so that it knows nothing of how the building was built")
    a_graph, s_graph = SceneGraph.load(out / "a_graph.json"), SceneGraph.load(out / "s_graph.json")
    T_bim_map = np.asarray(xyzquat_to_poses(np.array(metrics["T_bim_map"], dtype=float)))
    return deviations, a_graph, s_graph, T_bim_map, matches.get("floor")


def _parser() -> argparse.ArgumentParser:
    about = "What a finished run found of the building, for BIM viewers: an IFC copy and BCF topics."
    parser = Parser(prog="python -m sgslam.export", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="a run's folder, where the files go too")
    add("--bim", type=Path, required=True, metavar="FILE", help="the IFC model that the run was given")
    add("--ifc", action="store_true", help=f"only {IFC}")
    add("--bcf", action="store_true", help=f"only {BCF}")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    options = _parser().parse_args(arguments)
    both = options.ifc == options.bcf
    for line in export(options.out, options.bim, both or options.ifc, both or options.bcf):
        print(line)
    return 0


if __name__ == "__main__":
    run_command(main)
