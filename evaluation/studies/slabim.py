"""Runs the system on a session of the data set SLABIM: real scans with a real plan.

    python -m evaluation.studies.slabim --dataset DIR --session NAME --out DIR

Writes the session (see `data.datasets.slabim`) to DIR/sequence and runs `sgslam.run` on it, with the results in DIR.
Other options, such as `--set A.B=C`, are passed to `sgslam.run`.
"""

from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError

OWN = ("--scan-dir", "--bim", "--ground-truth", "--demo")


def main(arguments: list[str] | None = None) -> int:
    """The command line. Raises UserError."""
    parser = Parser(prog="python -m evaluation.studies.slabim", description="Run a session of SLABIM.")
    parser.add_argument("--dataset", type=Path, required=True, metavar="DIR", help="folder with BIM and sensor_data")
    parser.add_argument("--session", required=True, metavar="NAME", help="session, such as 3F_Region1")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--lay-out-only", action="store_true", help="write the sequence without running it")
    options, more = parser.parse_known_args(arguments)
    if fixed := [x for x in more if x.partition("=")[0] in OWN]:
        raise UserError(f"{fixed[0]}: is set by the session; leave it out")
    from data.datasets import SlabimSession

    sequence = options.out / "sequence"
    SlabimSession.open(options.dataset, options.session).lay_out(sequence)
    print(f"{sequence}: scans, a_graph.json, truth.tum, sequence.yaml")
    if options.lay_out_only:
        return 0
    from sgslam.run import main as run

    parts = {"--scan-dir": "scans", "--bim": "a_graph.json", "--ground-truth": "truth.tum"}
    files = [text for option, name in parts.items() for text in (option, str(sequence / name))]
    return run([*files, "--out", str(options.out), *more])


if __name__ == "__main__":
    run_command(main)
