"""`sgslam view OUT`: finished runs as a page in the browser, until Ctrl-C."""

from pathlib import Path
from typing import TYPE_CHECKING

from data.common.cli import Parser, run_command
from sgslam.viewer.page import stay

if TYPE_CHECKING:
    pass


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    parser = Parser(prog="python -m sgslam.cli.view", description="Finished runs as a page in the browser.")
    add = parser.add_argument
    add("runs", type=Path, nargs="+", metavar="OUT", help="a run's --out folder")
    add("--at", metavar="[HOST:]PORT", help="where the page is to be (default: 8080, of this machine alone)")
    add("--ground-truth", type=Path, metavar="FILE", help="sensor poses in the BIM frame, TUM (default: the run's)")
    options = parser.parse_args(arguments)
    # libraries are loaded only now, so that --help answers at once
    from data.trajectory import Trajectory
    from sgslam.viewer.finished import FinishedRun, FinishedView, told_truth
    from sgslam.viewer.page import HOST, PORT, Page, address

    at = (HOST, PORT) if options.at is None else address(options.at)
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    runs = [FinishedRun(path, truth or told_truth(path)) for path in options.runs]
    page = Page(at)
    FinishedView(page, runs)
    stay(page)
    return 0


if __name__ == "__main__":
    run_command(main)
