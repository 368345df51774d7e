"""A run over all of its scans in two processes. Its results are those of one process, bit by bit."""

import argparse
import gc
import logging
from typing import Any

from sgslam.cli.job.arguments import default_out
from sgslam.cli.job.run import interrupted
from sgslam.cli.job.scan_inputs import read_scan_inputs
from sgslam.cli.job.scan_loop import Progress, run_scans
from sgslam.cli.processes.mapping_process import MappingProcess
from sgslam.cli.processes.messages import MapInputs
from sgslam.cli.processes.tracking_side import SentCheckpoints, TrackingSide
from sgslam.session.checkpoints import load
from sgslam.warm_up import compile_ahead


def run_in_two_processes(options: argparse.Namespace, mapping: MappingProcess) -> dict[str, Any]:
    """Reads and tracks the scans here, while the `mapping` process builds the map; returns the content of metrics.json.

    Raises UserError, and KeyboardInterrupt at the second interrupt.
    """
    try:
        inputs = read_scan_inputs(options)
        options.out = options.out or default_out()
        compile_ahead().wait()
        mapping.begin(MapInputs(options, inputs.passed()))
        mapping.wait_until_ready()
        logging.getLogger("sgslam").setLevel(logging.INFO)  # that process decides what is printed
        side = TrackingSide(inputs.config, mapping)
        gc.freeze()  # what is loaded stays: the garbage collector need not scan it
        progress = Progress() if inputs.resumed_from is None else Progress(**load(options.out, side))
        checkpoints = SentCheckpoints(options.out, {})
        scans = inputs.scans
        stopped = run_scans(side, scans, progress, checkpoints, inputs.external_odometry, (), inputs.imu)
    except BaseException:
        mapping.kill()
        raise
    try:
        told = {"skipped": scans.skipped, "remarks": scans.remarks, "progress": progress.to_dict()}
        return side.finish(stopped=stopped, **told)
    except KeyboardInterrupt:
        mapping.kill()
        if stopped is not None:
            raise
        raise interrupted(options.out) from None
