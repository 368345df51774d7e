"""Converts a session of the data set SLABIM to the input of `sgslam.run`.

    python -m data.datasets DATASET SESSION --out DIR

DATASET is the folder with BIM and sensor_data.
"""

from pathlib import Path

from data.common.cli import Parser, run_command
from data.datasets import Slabim


def main(arguments: list[str] | None = None) -> int:
    """The command line. Raises UserError."""
    about = "Convert a session of the SLABIM data set to the input of sgslam run."
    parser = Parser(prog="python -m data.datasets", description=about)
    parser.add_argument("dataset", type=Path, metavar="DATASET", help="folder that contains BIM and sensor_data")
    parser.add_argument("session", metavar="SESSION", help="name of the session, such as 3F_Region1")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the converted session")
    options = parser.parse_args(arguments)
    Slabim(options.dataset).lay_out(options.session, options.out)
    print(f"{options.out}: scans, a_graph.json, truth.tum, sequence.yaml")
    return 0


if __name__ == "__main__":
    run_command(main)
