"""One run, of whose folder most tests look at a part."""

from pathlib import Path

import pytest
from shared_runs import write_anchored_run, written_once


@pytest.fixture(scope="session")
def anchored_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """See `write_anchored_run`; not to be changed."""
    return written_once(tmp_path_factory, "anchored_run", write_anchored_run)
