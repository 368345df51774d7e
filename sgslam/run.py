"""`python -m sgslam.run --scan-dir DIR --bim FILE`: scans and a building's model in, an anchored trajectory out."""

from data.common.cli import run_command
from data.common.errors import UserError
from sgslam.cli.execute import execute, run_parser
from sgslam.cli.options import RunOptions


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 when done, even if nothing could be anchored, and 3 if that is not enough for `--strict`.
    Raises UserError."""
    options = RunOptions.of(run_parser().parse_args(arguments))
    if options.resume is None and options.scan_dir is None and not options.demo:
        raise UserError("--scan-dir is missing; give the folder that holds the scans, or --demo")
    return execute(options)


if __name__ == "__main__":
    run_command(main)
