"""The buildings that the studies make themselves, each written to a file once, and the A-graphs of all."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from data.common.errors import UserError
from data.plans import load_bim
from data.plans.mesh_files import is_mesh
from data.scene_graph import SceneGraph

GENERATED = "generated/"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """A context that one process at a time may enter for this path, by a file `.NAME.lock` beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(f".{path.name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def demo_building(folder: Path) -> Path:
    """The demo building's IFC file, written to `folder` if missing."""
    from data.generation.demo_building import write_demo_building

    path = folder / "demo.ifc"
    with locked(path):
        if not path.exists():
            write_demo_building(path)
    return path


def generated_building(name: str, folder: Path) -> Path:
    """A random building's mesh by `KIND_SEED`, written to `folder` if missing. Raises UserError for an unknown name."""
    from data.generation.buildings import KINDS, generate_plan
    from data.generation.plan_mesh import write_plan_mesh

    kind, _, seed = name.rpartition("_")
    if kind not in KINDS or not seed.isdecimal():
        raise UserError(f"no generated building '{name}'; give KIND_SEED with a kind of {', '.join(KINDS)}")
    path = folder / f"{name}.stl"
    with locked(path):
        if not path.exists():
            write_plan_mesh(generate_plan(kind, int(seed)).graph, path)
    return path


def plan_graph(bim: Path) -> SceneGraph:
    """The A-graph of a building's file or mesh."""
    if is_mesh(bim):
        from data.plans.mesh_plan import read_mesh

        return read_mesh(bim).graph
    return load_bim(bim).graph
