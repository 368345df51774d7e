"""Records the S-graphs that the SLAM system builds on simulated drives, as test data for matching.

    python -m evaluation.drives.slam_graphs --out DIR [--bims demo FILE ...] [--list FILE] [--seeds N ...]

The graphs are those passed to the matcher, which never answers, so that no map is anchored: the first with each number
of rooms, and the last one. Nothing is tuned on them. Drives that exist in DIR already are skipped.
"""

import shutil
import sys
from collections.abc import Sequence as Several
from dataclasses import replace
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.plans import load_bim
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from data.scene_graph.motion import MIRRORED
from data.synthetic_maps.noise_models import DrawnGraph
from evaluation.drives.sequences import Sequence, SequenceSpec, prepare, read_specs, storey_of
from evaluation.drives.slam_graph_files import SlamDrive, SlamGraph, drive_file, write_drive
from evaluation.metrics.true_matches import true_matches
from matching import MatchResult
from sgslam.slam import SceneGraphSlam

LEAST_ROOMS = 3  # of a storey, to drive through it
LEAST_WALLS = 4  # of an S-graph, to record it


class Recorder:
    """A matcher that finds no match. It keeps the `first` S-graph of each number of rooms and the `last` one, each with
    the `seconds` since the start."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.first: dict[int, tuple[float, SceneGraph]] = {}
        self.last: tuple[float, SceneGraph] | None = None

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Keeps the S-graph, unless it is a mirror image; returns no match."""
        if s.frame.endswith(MIRRORED):
            return MatchResult("none", "recording only")
        self.last = self.seconds, s
        if s.rooms:
            self.first.setdefault(len(s.rooms), self.last)
        return MatchResult("none", "recording only")


def record(sequence: Sequence) -> SlamDrive:
    """Runs the system on a drive; returns the recorded S-graphs, without keyframes, and their truth."""
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
    kept = list(recorder.first.values())
    if recorder.last is not None and all(one is not recorder.last for one in kept):
        kept.append(recorder.last)
    graphs = []
    for one in kept:
        s_graph = replace(one[1], keyframes=())
        if len(s_graph.wall_surfaces) >= LEAST_WALLS:
            truth = true_matches(s_graph, storey, T_bim_map)
            by_room = dict.fromkeys(truth.rooms, truth.T_a_s)
            drawn = DrawnGraph(s_graph, truth.rooms, truth.wall_surfaces, truth.T_a_s, by_room, floor, False)
            graphs.append(SlamGraph(one[0], one is recorder.last, drawn))
    return SlamDrive(sequence.name, sequence.seed, sequence.a_graph, tuple(graphs))


def specs_of(bims: Several[str]) -> list[SequenceSpec]:
    """A drive through every storey with enough rooms; `demo` stands for the demo building. Raises UserError."""
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


def make(specs: Several[SequenceSpec], seeds: Several[int], out: Path) -> int:
    """Drives, records and writes what `out` lacks; returns the number of drives in it.

    The scans of a simulated drive are deleted after its S-graphs are written. A storey on which the robot cannot move
    is reported and left out.
    """
    wanted = [(spec, seed) for spec in specs for seed in (seeds if spec.simulated else seeds[:1])]
    for spec, seed in wanted:
        if drive_file(out, spec.name, seed).exists():
            continue
        try:
            drive = record(sequence := prepare(spec, seed, out / "drives"))
        except UserError as error:
            print(f"{spec.name}, seed {seed}: left out: {error}", file=sys.stderr)
            continue
        write_drive(out, drive, Path(spec.bim).stem)
        if spec.simulated:
            shutil.rmtree(sequence.scan_dir.parent)
        print(f"{spec.name}, seed {seed}: {len(drive.graphs)} S-graphs", flush=True)
    return sum(drive_file(out, spec.name, seed).exists() for spec, seed in wanted)


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.drives.slam_graphs", description="Record S-graphs of the system, with truth."
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the S-graphs")
    parser.add_argument("--bims", nargs="+", default=[], metavar="FILE", help="IFC files (all storeys), or 'demo'")
    parser.add_argument("--list", type=Path, metavar="FILE", help="YAML list of sequences")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1], metavar="N")
    options = parser.parse_args()
    listed = [] if options.list is None else read_specs(options.list)
    if not make([*listed, *specs_of(options.bims or ([] if listed else ["demo"]))], options.seeds, options.out):
        raise UserError("no drive could be simulated; give other buildings or sequences")
    return 0


if __name__ == "__main__":
    run_command(main)
