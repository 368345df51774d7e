"""The sequences of a measurement (scans, building and truth): simulated by seed, or recorded ones, listed in YAML."""

import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from data.common.build import content_hash
from data.common.errors import UserError
from data.plans.mesh_files import is_mesh
from data.scans import Scan, ScanFolder
from data.scene_graph import SceneGraph
from data.simulation import Changes
from data.simulation.simulate import PLAN
from data.trajectory import Trajectory
from evaluation.drives.buildings import GENERATED, demo_building, generated_building, locked, plan_graph
from evaluation.drives.conditions import NORMAL, Conditions
from evaluation.drives.weakened import WeakOdometry, weaken_odometry
from evaluation.harness.study import Case, Options

if TYPE_CHECKING:
    from sgslam.config import Config

STOREYS = Path(__file__).resolve().parents[1] / "storeys.yaml"


class SequenceSpec(BaseModel):
    """An entry of the list.

    With `scans` and `truth` it is a recorded sequence, the same for every seed; else a drive through `storey` is
    simulated. `demo` as `bim` stands for the demo building, `generated/KIND_SEED` for a generated one.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: str
    storey: str | None = None
    scans: str | None = None
    truth: str | None = None
    min_rooms: int = 8
    min_length: float = 120.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.scans is None) != (self.truth is None):
            raise ValueError(f"'{self.name}' needs both scans and truth, or neither")
        if self.simulated and self.storey is None and self.bim != "demo" and not (self.is_mesh or self.is_generated):
            raise ValueError(f"'{self.name}' is simulated but has no storey; add one")
        return self

    @property
    def simulated(self) -> bool:
        """Whether the drive is simulated."""
        return self.scans is None

    @property
    def is_mesh(self) -> bool:
        """Whether the building is a mesh."""
        return is_mesh(self.bim)

    @property
    def is_generated(self) -> bool:
        """Whether the building is a random one."""
        return self.bim.startswith(GENERATED)

    def files(self) -> set[str]:
        """The paths of its input files."""
        bim = None if self.bim == "demo" or self.is_generated else self.bim
        return {path for path in (bim, self.scans, self.truth) if path is not None}


class DriveOptions(Options):
    """Which drives are measured: the names of `sequences` in the YAML file `listed`, and the seeds of the drives."""

    listed: Path = STOREYS
    sequences: tuple[str, ...] = ("demo", "institute", "office", "basement")
    seeds: tuple[int, ...] = (0, 1, 2)

    def drives(self) -> Iterator[tuple[SequenceSpec, int]]:
        """Each sequence with each seed; a recorded one, which is the same for every seed, with the first.

        Raises UserError for an unknown name and as `read_specs` does.
        """
        for spec in select_sequences(read_specs(self.listed), self.sequences):
            for seed in self.seeds if spec.simulated else self.seeds[:1]:
                yield spec, seed

    def in_turn(
        self, cells: Iterable[dict[str, Any]], per_cell: int | None
    ) -> Iterator[tuple[SequenceSpec, int, dict[str, Any]]]:
        """Each of the `cells` of a design with the next `per_cell` drives of all (None: with all of them), in random
        order, again and again."""
        drives = list(self.drives())
        drawn, taken = np.random.default_rng(0).permutation(len(drives)), len(drives) if per_cell is None else per_cell
        for number, cell in enumerate(cells):
            for k in range(taken):
                spec, seed = drives[drawn[(number * taken + k) % len(drives)]]
                yield spec, seed, cell


class DriveCase(Case):
    """A drive through a sequence."""

    sequence: SequenceSpec
    seed: int

    def files(self) -> set[str]:
        """The sequence's files."""
        return self.sequence.files()


@dataclass(frozen=True)
class Sequence:
    """A sequence that is ready to run: the whole building's A-graph and the true sensor poses in the BIM frame.

    `bim` is the file of the A-graph. `weak` is the degraded odometry, None unless the conditions ask for one.
    """

    name: str
    seed: int
    scan_dir: Path
    bim: Path
    a_graph: SceneGraph
    truth: Trajectory
    conditions: Conditions = NORMAL
    weak: WeakOdometry | None = None


def read_specs(path: Path) -> list[SequenceSpec]:
    """Reads a YAML list of sequences. Raises UserError for missing or unknown entries.

    Paths are relative to the working directory. A recorded sequence takes five lines (`bim` is an IFC file or an
    A-graph; `truth` has sensor poses in the building's frame, TUM format):

        - name: my building
          bim: building.ifc
          scans: scans
          truth: truth.tum
          storey: Ground floor
    """
    try:
        rows = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: cannot read this file ({type(error).__name__}); give a YAML list") from None
    try:
        specs = TypeAdapter(Annotated[list[SequenceSpec], Field(min_length=1)]).validate_python(rows)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "list of sequences"
        raise UserError(f"{path}: {where}: {first['msg'].removeprefix('Value error, ')}") from None
    names = [spec.name for spec in specs]
    if len(set(names)) != len(names):
        raise UserError(f"{path}: two sequences have the same name")
    return specs


def select_sequences(specs: list[SequenceSpec], names: tuple[str, ...]) -> list[SequenceSpec]:
    """The sequences with these names, all for none. Raises UserError for an unknown name."""
    if unknown := sorted(set(names) - {spec.name for spec in specs}):
        there = ", ".join(spec.name for spec in specs)
        raise UserError(f"no sequence '{unknown[0]}' in the list; there are: {there}")
    return [spec for spec in specs if not names or spec.name in names]


def prepare(spec: SequenceSpec, seed: int, folder: Path, conditions: Conditions = NORMAL) -> Sequence:
    """Loads a sequence; a drive that is missing in `folder` is simulated there first.

    Raises UserError for conditions that the sequence cannot have, and as the simulator and the readers do.
    """
    with locked(folder / f"{spec.name}-{seed}"):
        return _prepared(spec, seed, folder, conditions)


def _prepared(spec: SequenceSpec, seed: int, folder: Path, conditions: Conditions) -> Sequence:
    bim, storey = building_of(spec, folder)
    graph = plan_graph(bim)
    if spec.scans is not None and spec.truth is not None:
        if conditions.of_the_drive:
            raise UserError(f"'{spec.name}': not simulated, so its walls and its path cannot be changed; leave it out")
        scan_dir, truth_path, drive = Path(spec.scans), Path(spec.truth), folder / f"{spec.name}-odometry"
    else:
        size = f"{spec.min_rooms}-{spec.min_length:g}"
        drive = folder / f"{spec.name}-{size}-{seed}{conditions.of_the_drive}"
        if not drive.exists():
            _simulate(spec, bim, storey, drive, seed, conditions)
        scan_dir, truth_path = drive / "scans", drive / "truth.tum"
        if (drive / PLAN).exists():  # the plan without the added walls
            bim, graph = drive / PLAN, plan_graph(drive / PLAN)
    truth = Trajectory.read_tum(truth_path)
    sequence = Sequence(spec.name, seed, scan_dir, bim, graph, truth, conditions)
    if not conditions.weaken:
        return sequence
    cache = drive / f"odometry-{content_hash()}.tum"
    cache.parent.mkdir(exist_ok=True)
    if not cache.exists():
        odometry_of_run(ScanFolder(scan_dir)).write_tum(cache)
    return replace(sequence, weak=weaken_odometry(Trajectory.read_tum(cache), truth, seed))


def plan_of(spec: SequenceSpec, folder: Path) -> SceneGraph:
    """The whole building's A-graph; the demo building is written to `folder` if missing."""
    return plan_graph(building_of(spec, folder)[0])


def building_of(spec: SequenceSpec, folder: Path) -> tuple[Path, str]:
    """The building's file and the storey; the demo building and generated ones are written to `folder` if missing."""
    if spec.is_generated:
        return generated_building(spec.bim.removeprefix(GENERATED), folder), spec.storey or ""
    if spec.bim != "demo":
        return Path(spec.bim), spec.storey or ""
    from data.generation.demo_building import DEMO_STOREY

    return demo_building(folder), spec.storey or DEMO_STOREY


def _simulate(spec: SequenceSpec, bim: Path, storey: str, drive: Path, seed: int, conditions: Conditions) -> None:
    from data.simulation.simulate import simulate

    for unfinished in drive.parent.glob(f".{drive.name}.*"):  # left by an interrupted run
        shutil.rmtree(unfinished, ignore_errors=True)  # the lock is a file and stays
    changes = Changes(conditions.moved_walls, conditions.absent_walls, conditions.unplanned_walls)
    simulate(
        bim, storey, drive, seed=seed, min_rooms=spec.min_rooms, min_length=spec.min_length,
        changes=changes if changes.any else None, and_back=conditions.loops,
    )  # fmt: skip


def odometry_of_run(scans: Iterable[Scan], config: "Config | None" = None) -> Trajectory:
    """T_odom_sensor of the odometry alone, as a run uses it, without a map; `config` selects it, our own by default.

    The frame is level, with the first pose's place and heading.
    """
    from evaluation.drives.runs import tracked_by_run
    from sgslam.config import Config

    return tracked_by_run(scans, config or Config()).poses


def storey_of(a_graph: SceneGraph, T_bim_sensor: NDArray[np.float64]) -> str | None:
    """The id of the storey whose floor is next below a sensor pose (4, 4); None if there is none."""
    below = [f for f in a_graph.floors if f.elevation is not None and f.elevation <= T_bim_sensor[2, 3]]
    return max(below, key=lambda f: f.elevation or 0.0).id if below else None
