"""The buildings that the studies drive through: listed ones and generated ones."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.generation.level_building import STOREY
from data.plans import load_bim
from data.plans.mesh_plan import is_mesh
from data.scene_graph import SceneGraph

GENERATED = "generated/"
LEVELS = "levels/"
WALLS = "walls/"
FIRST_TEST_SEED = 902_000
"""Generated buildings below were used for training, or to choose settings."""


class Building(BaseModel):
    """A building: an IFC file, a mesh, `demo`, `generated/KIND_SEED`, `walls/KIND_SEED` with walls, doors, windows and
    columns as elements, or `levels/KIND_SEED` with floors and ceilings at several heights (the demo likewise; one in
    three has galleries); the `storey` that is driven through, None for the lowest. Settings were chosen by those for
    `development`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: str
    storey: str | None = None
    role: Literal["development", "test"] = "test"

    def files(self) -> set[str]:
        """The path of its file; none for those that are made."""
        if self.bim == "demo" or self.bim.startswith((GENERATED, LEVELS, WALLS)):
            return set()
        return {self.bim}


def generated(*seeds: int, kinds: tuple[str, ...] = ("office", "corridor", "l_shape", "apartment")) -> tuple[str, ...]:
    """The names of generated buildings, of these seeds after the first one for tests."""
    return tuple(f"{GENERATED}{kind}_{FIRST_TEST_SEED + seed}" for seed in seeds for kind in kinds)


@cache
def _listed() -> dict[str, Building]:
    rows = yaml.safe_load(Path(__file__).with_name("buildings.yaml").read_text())
    return {building.name: building for building in map(Building.model_validate, rows)}


def building_named(name: str) -> Building:
    """A listed building, or one that is made of its name. Raises UserError for an unknown one."""
    if name.startswith((GENERATED, LEVELS, WALLS)):
        seed = name.rpartition("_")[2]
        is_test = seed.isdecimal() and int(seed) >= FIRST_TEST_SEED
        return Building(name=name, bim=name, role="test" if is_test else "development")
    if name not in _listed():
        there = ", ".join(_listed())
        raise UserError(f"no building '{name}'; there are {there} and {GENERATED}KIND_SEED")
    return _listed()[name]


def building_file(name: str, work: Path) -> tuple[Path, str]:
    """A building's file and the name of its storey; those that are made are written to `work` once.

    Raises UserError for an unknown one.
    """
    building = building_named(name)
    if building.bim == "demo":
        from data.generation import DEMO_STOREY, write_demo_building

        path = work / "demo.ifc"
        with locked(path):
            if not path.exists():
                write_demo_building(path)
        return path, building.storey or DEMO_STOREY
    if building.bim.startswith(LEVELS):
        return _level_building(building.bim.removeprefix(LEVELS), work, as_planned=False), STOREY
    if building.bim.startswith(WALLS):
        return _wall_building(building.bim.removeprefix(WALLS), work), STOREY
    if not building.bim.startswith(GENERATED):
        return Path(building.bim), building.storey or ""
    from data.generation.level_building import write_plan_mesh

    path = work / f"{building.bim.removeprefix(GENERATED)}.stl"
    with locked(path):
        if not path.exists():
            write_plan_mesh(_generated(building.bim.removeprefix(GENERATED)), path)
    return path, ""


def flat_plan_of(name: str, work: Path) -> Path:
    """The file of a `levels/KIND_SEED` without suspended ceilings and raised floors. Raises UserError for others."""
    if not name.startswith(LEVELS):
        raise UserError(f"building '{name}': only those named {LEVELS}KIND_SEED are made without their levels")
    return _level_building(name.removeprefix(LEVELS), work, as_planned=True)


def _level_building(name: str, work: Path, as_planned: bool) -> Path:
    from data.generation.level_building import write_level_building, write_level_demo

    kind, _, number = name.rpartition("_")
    if not number.isdecimal():
        raise UserError(f"no building '{LEVELS}{name}'; give KIND_SEED, with a kind as of {GENERATED} or demo")
    path, seed = work / f"levels_{name}{'_flat' * as_planned}.ifc", int(number)
    with locked(path):
        if not path.exists() and kind == "demo":
            write_level_demo(path, seed, flat=as_planned)
        elif not path.exists():
            write_level_building(_generated(name), path, seed, high=seed % 3 == 0, flat=as_planned)
    return path


def _wall_building(name: str, work: Path) -> Path:
    from data.generation.wall_building import write_wall_building

    path = work / f"walls_{name}.ifc"
    with locked(path):
        if not path.exists():
            write_wall_building(_generated(name, plain=True), path, int(name.rpartition("_")[2]))
    return path


def _generated(name: str, plain: bool = False) -> SceneGraph:
    from data.generation.buildings import KINDS, generate_plan

    kind, _, seed = name.rpartition("_")
    if kind not in KINDS or not seed.isdecimal():
        raise UserError(f"no building '{GENERATED}{name}'; give KIND_SEED with a kind of {', '.join(KINDS)}")
    return generate_plan(kind, int(seed), plain).graph


def plan_graph(bim: Path) -> SceneGraph:
    """The A-graph of a building's file or mesh."""
    if is_mesh(bim):
        from data.plans.mesh_plan import read_mesh

        return read_mesh(bim).graph
    return load_bim(bim).graph


def storey_of(a_graph: SceneGraph, T_bim_sensor: NDArray[np.float64]) -> str | None:
    """The id of the storey whose floor is next below a sensor pose (4, 4); None if there is none."""
    below = [f for f in a_graph.floors if f.elevation is not None and f.elevation <= T_bim_sensor[2, 3]]
    return max(below, key=lambda f: f.elevation or 0.0).id if below else None


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """A context that one process at a time may enter for this path, by a file `.NAME.lock` beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(f".{path.name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
