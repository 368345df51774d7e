"""What the report says of the planned elements: counts, table, outlines in the plan."""

from sgslam.report.elements.labels import VERDICTS, element_name, slug
from sgslam.report.elements.outlines import DrawnElement, drawn_elements
from sgslam.report.elements.table import COLUMNS, Cell, ElementRow, coverage, element_rows, verdict_counts

__all__ = [
    "COLUMNS",
    "VERDICTS",
    "Cell",
    "DrawnElement",
    "ElementRow",
    "coverage",
    "drawn_elements",
    "element_name",
    "element_rows",
    "slug",
    "verdict_counts",
]
