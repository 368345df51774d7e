"""`python -m sgslam.live SOURCE --bim FILE`: scans as they come, a line of JSON for each. `sgslam live` is the same."""

import gc
import sys
from pathlib import Path
from typing import Any

from data.common.cli import run_command
from data.common.errors import UserError


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 once the results are written. Raises UserError."""
    from sgslam.live.options import checked_config, parser

    options = parser().parse_args(arguments)
    # imported only now, so that --help and a missing argument respond at once
    import logging

    from threadpoolctl import threadpool_limits

    from sgslam.cli.job.scan_loop import interruptible
    from sgslam.live.commands import PoseLines
    from sgslam.live.live_slam import LiveSlam
    from sgslam.live.loop import LiveLoop

    config, stream = checked_config(options), _opened(options.source, options.topic)
    stream.stamped = config.tracking.stamp
    threadpool_limits(1, user_api="blas")  # a scan is small: more threads would only wait for each other
    sys.setswitchinterval(1e-4)  # with the default interval the reading thread delays the answers
    logging.getLogger("sgslam").setLevel(logging.INFO)
    with interruptible() as interruption:
        live = LiveSlam.of(options, config, options.most_waiting)
        gc.freeze()  # what is loaded stays: the garbage collector need not scan it
        poses = None if options.source == "-" else PoseLines(sys.stdin)
        loop = LiveLoop(live, stream, sys.stdout, poses, options.idle, lambda: bool(interruption))
        print(f"ready; results will be in {options.out}", file=sys.stderr)
        fault = loop.run()
    print(f"{live.waiting} scans still wait for the map; then the results are written", file=sys.stderr)
    metrics = live.finish(stream.skipped, stream.remarks, {"since_arrival": loop.latencies.to_dict()})
    print(_summary(metrics, options.out), file=sys.stderr)
    if fault is not None:
        raise UserError(f"{fault}; the results so far are in {options.out}")
    return 0


def _opened(source: str, topic: str | None) -> Any:
    from data.streams import GrowingFolder, McapPipe

    if source == "-":
        return McapPipe(sys.stdin.buffer, topic)
    if topic is not None:
        raise UserError(f"--topic {topic}: a folder has no topics")
    return GrowingFolder(source)


def _summary(metrics: dict[str, Any], out: Path) -> str:
    told = metrics["live"]["since_arrival"]
    where = "anchored" if metrics["anchored"] else "not anchored"
    times = f"{told['p50_ms']} ms (median; 99 %: {told['p99_ms']}, longest: {told['longest_ms']})"
    return (
        f"{where}: {metrics['reason']}\n{told['answers']} scans, answered within {times}; "
        f"at most {told['most_waiting']} waited for the map\nreport: {out / 'report.html'}"
    )


if __name__ == "__main__":
    run_command(main)
