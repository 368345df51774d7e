"""Records the S-graphs that the SLAM system builds on simulated drives, as test data for matching.

    python -m evaluation.drives.slam_graphs --out DIR [--bims demo FILE ...] [--list FILE] [--seeds N ...]

The graphs are those passed to the matcher, which never answers, so that no map is anchored: the first with each number
of rooms, and the last one. Nothing is tuned on them. Drives that exist in DIR already are skipped.
"""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import DrawnGraph
from evaluation.drives.sequences import Sequence, SequenceSpec, prepare, read_specs
from evaluation.drives.slam_graph_files import SlamDrive, SlamGraph, drive_file, write_drive
from evaluation.metrics.true_matches import true_matches
from matching import MatchResult

LEAST_ROOMS = 3  # of a storey, to drive through it
LEAST_WALLS = 4  # of an S-graph, to record it


class Recorder:
    """A matcher that finds no match and records its `calls`: (seconds since the start, S-graph)."""

    def __init__(self) -> None:
        self.calls: list[tuple[float, SceneGraph]] = []
        self.seconds = 0.0

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Records the S-graph; returns no match."""
        self.calls.append((self.seconds, s))
        return MatchResult("none", "recording only")

    def chosen(self) -> list[tuple[float, SceneGraph]]:
        """The first S-graph of each number of rooms, and the last one."""
        first = {len(s.rooms): (seconds, s) for seconds, s in reversed(self.calls) if len(s.rooms)}
        calls = sorted([*first.values(), self.calls[-1]], key=lambda call: call[0])
        return [k for n, k in enumerate(calls) if k[1] is not calls[n - 1][1] or not n]


def record(sequence: Sequence) -> SlamDrive:
    """Runs the system on a drive; returns the recorded S-graphs, without keyframes, and their truth."""
    from data.scans import ScanFolder
    from evaluation.drives.sequences import storey_of
    from sgslam.slam import SceneGraphSlam

    T_bim_map = sequence.truth.poses[0]
    floor = storey_of(sequence.a_graph, T_bim_map)
    storey = sequence.a_graph.on_floor(floor)
    recorder = Recorder()
    slam = SceneGraphSlam(sequence.a_graph, recorder)
    start: int | None = None
    for scan in ScanFolder(sequence.scan_dir):
        start = scan.stamp_ns if start is None else start
        recorder.seconds = (scan.stamp_ns - start) / 1e9
        slam.add_scan(scan.stamp_ns, scan.points)
    slam.finish()
    graphs = []
    for seconds, s_graph in recorder.chosen():
        if len(s_graph.wall_surfaces) >= LEAST_WALLS:
            drawn = _with_truth(replace(s_graph, keyframes=()), storey, T_bim_map, floor)
            graphs.append(SlamGraph(seconds, s_graph is recorder.calls[-1][1], drawn))
    return SlamDrive(sequence.name, sequence.seed, sequence.a_graph, tuple(graphs))


def _with_truth(s_graph: SceneGraph, storey: SceneGraph, T_bim_map: np.ndarray, floor: str | None) -> DrawnGraph:
    truth = true_matches(s_graph, storey, T_bim_map)
    by_room = dict.fromkeys(truth.rooms, truth.T_a_s)
    return DrawnGraph(s_graph, truth.rooms, truth.wall_surfaces, truth.T_a_s, by_room, floor, False)


def specs_of(bims: list[str]) -> list[SequenceSpec]:
    """A drive through every storey with enough rooms; `demo` stands for the demo building. Raises UserError."""
    from data.plans import load_bim

    specs = []
    for bim in bims:
        if bim == "demo":
            specs.append(SequenceSpec(name="demo", bim="demo"))
            continue
        graph = load_bim(bim).graph
        for n, floor in enumerate(graph.floors):
            if sum(r.floor == floor.id for r in graph.rooms) >= LEAST_ROOMS:
                specs.append(SequenceSpec(name=f"{Path(bim).stem}-{n}", bim=bim, storey=floor.id))
    return specs


def make(specs: list[SequenceSpec], seeds: list[int], out: Path) -> int:
    """Drives, records and writes what `out` lacks; returns the number of drives in it.

    The scans of a simulated drive are deleted after its S-graphs are written. A storey on which the robot cannot move
    is reported and left out.
    """
    drives = out / "drives"
    drives.mkdir(parents=True, exist_ok=True)
    there = 0
    for spec in specs:
        for seed in seeds if spec.scans is None else seeds[:1]:
            if not drive_file(out, spec.name, seed).exists():
                try:
                    drive = record(sequence := prepare(spec, seed, drives))
                except UserError as error:
                    print(f"{spec.name}, seed {seed}: left out: {error}", file=sys.stderr)
                    continue
                write_drive(out, drive, "demo" if spec.bim == "demo" else Path(spec.bim).stem)
                if spec.simulated:
                    shutil.rmtree(sequence.scan_dir.parent)
                print(f"{spec.name}, seed {seed}: {len(drive.graphs)} S-graphs", flush=True)
            there += 1
    return there


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.drives.slam_graphs", description="Record S-graphs of the system, with truth."
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the S-graphs")
    parser.add_argument("--bims", nargs="+", metavar="FILE", help="IFC files (all storeys), or 'demo'")
    parser.add_argument("--list", type=Path, metavar="FILE", help="YAML list of sequences")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1], metavar="N")
    options = parser.parse_args()
    specs = [] if options.list is None else read_specs(options.list)
    specs += specs_of(options.bims or ([] if options.list else ["demo"]))
    if not make(specs, options.seeds, options.out):
        raise UserError("no drive could be simulated; give other buildings or sequences")
    return 0


if __name__ == "__main__":
    run_command(main)
