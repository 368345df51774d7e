"""The notebooks of the documentation run from top to bottom, and are kept without what a run leaves in them."""

import json
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "notebooks"


def code_cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("path", sorted(FOLDER.iterdir()), ids=lambda path: path.name)
def test_a_notebook_has_no_outputs(path: Path) -> None:
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code_cells(path))


@pytest.mark.long
@pytest.mark.slow
def test_the_first_run_is_anchored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    matplotlib.use("agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(code_cells(FOLDER / "first_run.ipynb"), 1):
        exec(compile("".join(cell["source"]), f"code cell {number}", "exec"), names)
    assert names["result"].anchored and np.sqrt(np.mean(names["errors"] ** 2)) < 0.02
    anchored = [update.anchored for update in names["updates"]]
    assert not anchored[0] and anchored[-1]
    assert list(tmp_path.rglob("report.html"))
