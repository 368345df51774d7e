"""`sgslam view OUT`: shows finished runs in the browser until Ctrl-C."""

from pathlib import Path

from data.common.cli import Parser, run_command


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    parser = Parser(prog="python -m sgslam.cli.view", description="Show finished runs in the browser.")
    add = parser.add_argument
    add("runs", type=Path, nargs="+", metavar="OUT", help="--out folder of a run")
    add(
        "--at",
        default="8080",
        metavar="[HOST:]PORT",
        help="address of the page (default: port 8080, this machine only)",
    )
    add("--ground-truth", type=Path, metavar="FILE", help="true sensor poses in the BIM frame (default: the run's)")
    options = parser.parse_args(arguments)
    # imported only now, so that --help responds at once
    from data.trajectory import Trajectory
    from sgslam.viewer.finished import FinishedRun, FinishedView, stored_truth
    from sgslam.viewer.page import Page, parse_address, serve_until_interrupted

    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    runs = [FinishedRun(path, truth or stored_truth(path)) for path in options.runs]
    page = Page(parse_address(options.at))
    FinishedView(page, runs)
    serve_until_interrupted(page)
    return 0


if __name__ == "__main__":
    run_command(main)
