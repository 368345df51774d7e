"""What is measured on: scans, building and truth; simulated by seed, or a user's own, listed in YAML."""

from dataclasses import dataclass
from pathlib import Path

import yaml

from data.bim import load_bim
from data.errors import UserError
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory


@dataclass(frozen=True)
class SequenceSpec:
    """A line of the list. With `scans` and `truth` it is a user's own and the same for every seed; else the storey of
    the building is driven by the simulator. `demo` stands for the demo building's path."""

    name: str
    bim: str
    storey: str | None = None
    scans: str | None = None
    truth: str | None = None
    min_rooms: int = 8
    min_length: float = 120.0


@dataclass(frozen=True)
class Sequence:
    """Ready to run: the whole building's A-graph, and the truth (sensor poses in the BIM frame)."""

    name: str
    seed: int
    scan_dir: Path
    a_graph: SceneGraph
    truth: Trajectory


def read_specs(path: Path) -> list[SequenceSpec]:
    """Reads a YAML list of sequences; raises UserError for what is missing or unknown.

    A user's own takes six lines:

        - name: my building
          bim: building.ifc
          scans: scans
          truth: truth.tum
          storey: Ground floor
    """
    try:
        rows = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: cannot be read as YAML ({type(error).__name__})") from None
    if not isinstance(rows, list) or not rows:
        raise UserError(f"{path}: not a list of sequences")
    try:
        specs = [SequenceSpec(**row) for row in rows]
    except TypeError as error:
        raise UserError(f"{path}: {str(error).replace('SequenceSpec.__init__() ', 'a sequence ')}") from None
    for spec in specs:
        if (spec.scans is None) != (spec.truth is None):
            raise UserError(f"{path}: '{spec.name}' needs both scans and truth, or neither")
        if spec.scans is None and spec.storey is None and spec.bim != "demo":
            raise UserError(f"{path}: '{spec.name}' is to be simulated and names no storey")
    names = [spec.name for spec in specs]
    if len(set(names)) != len(names):
        raise UserError(f"{path}: two sequences have the same name")
    return specs


def prepare(spec: SequenceSpec, seed: int, folder: Path) -> Sequence:
    """Simulates what is not there yet, into `folder`, and loads the rest."""
    bim, storey = Path(spec.bim), spec.storey
    if spec.bim == "demo":
        from data.demo_building import DEMO_STOREY, write_demo_building

        bim, storey = folder / "demo.ifc", storey or DEMO_STOREY
        if not bim.exists():
            write_demo_building(bim)
    if spec.scans is not None and spec.truth is not None:
        scan_dir, truth = Path(spec.scans), Path(spec.truth)
    else:
        drive = folder / f"{spec.name}-{seed}"
        if not drive.exists():
            from data.simulate import simulate

            simulate(bim, str(storey), drive, seed=seed, min_rooms=spec.min_rooms, min_length=spec.min_length)
        scan_dir, truth = drive / "scans", drive / "truth.tum"
    return Sequence(spec.name, seed, scan_dir, load_bim(bim).graph, Trajectory.read_tum(truth))
