"""The report on paper: A4 sheets with a head and numbered pages, drawn by matplotlib."""

from sgslam.report.pdf.document import FILE, sheets, write_pdf
from sgslam.report.pdf.finished import report_data

__all__ = [
    "FILE",
    "report_data",
    "sheets",
    "write_pdf",
]
