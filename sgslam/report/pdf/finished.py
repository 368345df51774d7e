"""What the report says of a finished run, read from its folder."""

import csv
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.report.contents import ReportData
from sgslam.report.elements import shown_as_element
from sgslam.report.run_folder import RunFolder
from sgslam.report.scan_states import ScanStates

SIGMA = "trajectory_sigma.csv"


def report_data(run: RunFolder) -> ReportData:
    """The run without ground truth and without the log of its anchors. Raises UserError for a damaged folder."""
    in_map, odometry = (Trajectory.read_tum(run.path / f"trajectory_{name}.tum") for name in ("map", "odometry"))
    states = _states(run.path / SIGMA)
    return ReportData(
        run.a_graph, run.s_graph, in_map, odometry, None, run.T_bim_map, run.matches, run.metrics, run.deviations,
        states if states is not None and len(states.seconds) == len(in_map) else None, 
        elements=[*run.elements, *map(shown_as_element, run.unplanned)],
    )  # fmt: skip


def _states(path: Path) -> ScanStates | None:
    if not path.is_file():
        return None
    with path.open() as file:
        rows = list(csv.DictReader(file))
    try:
        seconds = np.array([float(row["stamp_s"]) for row in rows])
        sigma = np.array([(float(row["sigma_x_m"]), float(row["sigma_y_m"])) for row in rows]).reshape(-1, 2)
        part = np.array([int(row["part"]) for row in rows], dtype=np.int64)
        lost = np.array([row["health"] == "lost" for row in rows], dtype=bool)
    except (KeyError, TypeError, ValueError):
        raise UserError(f"{path}: is damaged; run it again") from None
    return ScanStates(seconds - seconds[:1], lost, part, sigma)
