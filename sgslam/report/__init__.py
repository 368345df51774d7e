"""The report and the plan picture of a run."""

from sgslam.report.contents import ReportData
from sgslam.report.run_folder import RunFolder

__all__ = ["ReportData", "RunFolder"]
