"""What the report says of the elements, planned or not: counts, table, outlines in the plan."""

from sgslam.report.elements.labels import VERDICTS, element_name, slug
from sgslam.report.elements.outlines import DrawnElement, drawn_elements
from sgslam.report.elements.table import (
    COLUMNS,
    Cell,
    ElementRow,
    coverage,
    element_rows,
    planned_count,
    verdict_counts,
)
from sgslam.report.elements.unplanned import shown_as_element

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
    "planned_count",
    "shown_as_element",
    "slug",
    "verdict_counts",
]
