"""Rows of a study as its tables get them."""

from collections.abc import Iterable

import pandas as pd

from evaluation.harness import Case, Record
from evaluation.harness.provenance import Provenance
from evaluation.harness.row_file import Row
from evaluation.harness.tables import frame

MADE = Provenance(build="b", commit="c", command="python -m evaluation run", machine="m", date="2026-01-01 00:00")


def rows_of(records: Iterable[tuple[Case, Record]]) -> pd.DataFrame:
    """The DataFrame of these cases and their records."""
    return frame([Row(case.model_dump(mode="json"), record.model_dump(mode="json"), MADE) for case, record in records])
