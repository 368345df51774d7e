"""A case: which building, who carries which sensor, what goes wrong, and what is run on the scans."""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from data.common.build import PRODUCT
from data.common.errors import UserError
from evaluation.study import Case, Options, key_of

RECORDING = "../shared/data/motion/handheld_survey.tum"
"""The motion of a hand-held scanner in a real building."""
GENERATED, PLAN = "generated/", "plan/"
Degrees = tuple[float, float, float]


class Building(BaseModel):
    """A building: an IFC file, a mesh, `demo`, `generated/KIND_SEED`, or `plan/FILE#NAME`, a plan that is built up as a
    mesh; the `storey` that is driven through, None for the lowest. Settings were chosen by those for `development`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    bim: str
    storey: str | None = None
    role: Literal["development", "test"] = "test"

    def files(self) -> set[str]:
        """The path of its file; none for those that are made."""
        if self.bim == "demo" or self.bim.startswith(GENERATED):
            return set()
        return {self.bim.removeprefix(PLAN).partition("#")[0]}


@cache
def _listed() -> dict[str, Building]:
    rows = yaml.safe_load(Path(__file__).with_name("buildings.yaml").read_text())
    return {building.name: building for building in map(Building.model_validate, rows)}


def building_named(name: str) -> Building:
    """A listed building, or one that is made of its name. Raises UserError for an unknown one."""
    if name.startswith((GENERATED, PLAN)):
        return Building(name=name, bim=name)
    if name not in _listed():
        there = ", ".join(_listed())
        raise UserError(f"no building '{name}'; there are {there}, {GENERATED}KIND_SEED and {PLAN}FILE#NAME")
    return _listed()[name]


class DriveCase(Case):
    """A run on a drive through a building.

    The drive has the first `seconds` of a tour, or with None the whole tour of `storeys`. `carrier` is one of the
    simulator's or a recorded motion FILE.tum, which may be played at another `pace` or `backwards`. `mount_deg` are
    roll, pitch and yaw of the sensor on its carrier. The sensor moves within each scan; without `times`, it is unknown
    when the points were measured. `imu` is a class of IMUs in the sensor. The building differs from its plan by
    `changes`; `trouble` is what is wrong with sensor, recording or plan, with its severity (`evaluation.conditions`).
    `variant` is what is run (`evaluation.variants`).
    """

    building: str
    seed: int = 0
    carrier: str = "wheeled"
    pace: PositiveFloat = 1.0
    backwards: bool = False
    mount_deg: Degrees = (0.0, 0.0, 0.0)
    sensor: str = "VLP-16"
    times: bool = True
    imu: str | None = None
    effects: tuple[str, ...] = ()
    changes: str = ""
    seconds: float | None = Field(60.0, ge=5.0)
    storeys: tuple[str, ...] = ()
    trouble: str = ""
    variant: str = "anchored"

    @property
    def group(self) -> str:
        """The fields of the simulated drive: cases of one drive share its scans."""
        shaken = {"trouble": "shaken"} if self.trouble == "shaken" else {}
        return key_of(self.model_dump(mode="json", exclude={"times", "trouble", "variant"}) | shaken)

    @property
    def depends(self) -> tuple[str, ...]:
        """What is not ours changes with the simulator alone."""
        from evaluation.variants import PEERS

        return ("data",) if self.variant in PEERS else PRODUCT

    def files(self) -> set[str]:
        """The building's file, a recorded motion, and the weights that a variant names."""
        weights = self.variant.partition("@")[2]
        named = {self.carrier} if self.carrier.endswith(".tum") else set()
        return building_named(self.building).files() | named | ({weights} if "/" in weights else set())


class DriveOptions(Options):
    """Which `buildings` are driven through with which `seeds`, for how many `seconds`."""

    buildings: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)
    seconds: PositiveFloat = 60.0

    def drives(self) -> Iterator[dict[str, Any]]:
        """The fields of each drive. Raises UserError for an unknown building."""
        for building, seed in product(self.buildings, self.seeds):
            yield {"building": building_named(building).name, "seed": seed, "seconds": self.seconds}

    def in_turn(self, cells: Sequence[dict[str, Any]], per_cell: int | None) -> Iterator[dict[str, Any]]:
        """Each of the `cells` of a design with the next `per_cell` of all drives in random order, again and again; with
        all of them for None."""
        drives = list(self.drives())
        order, each = np.random.default_rng(0).permutation(len(drives)), per_cell or len(drives)
        for number, cell in enumerate(cells):
            for k in range(number * each, (number + 1) * each):
                yield {**drives[order[k % len(drives)]], **cell}


def cases_of(designs: Sequence[dict[str, Any]], variants: Sequence[str]) -> list[DriveCase]:
    """A case for each design and variant."""
    return [DriveCase(**{**design, "variant": variant}) for design in designs for variant in variants]
