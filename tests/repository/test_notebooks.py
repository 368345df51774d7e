"""The notebooks of the documentation run from top to bottom, and are kept without what a run leaves in them."""

import json
import re
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "notebooks"
FIRST_RUN = FOLDER / "first_run.ipynb"


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == kind]


def run(path: Path) -> dict[str, Any]:
    """Runs the cells in order, as a kernel does; returns the names that they leave."""
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells(path, "code"), 1):
        exec(compile("".join(cell["source"]), f"{path.name}, code cell {number}", "exec"), names)
    return names


@pytest.mark.parametrize("path", sorted(FOLDER.iterdir()), ids=lambda path: path.name)
def test_a_notebook_has_no_outputs_and_its_links_lead_somewhere(path: Path) -> None:
    notebook = json.loads(path.read_text())
    assert notebook["nbformat"] == 4 and notebook["metadata"].keys() == {"kernelspec", "language_info"}
    for cell in cells(path, "code"):
        assert cell["outputs"] == [] and cell["execution_count"] is None and cell["metadata"] == {}, cell["id"]
    text = "\n".join("".join(cell["source"]) for cell in cells(path, "markdown"))
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
    assert targets and [target for target in targets if not (FOLDER / target).is_file()] == []
    for page in (ROOT / "README.md", ROOT / "docs" / "index.md"):
        assert f"notebooks/{path.name})" in page.read_text(), page


@pytest.mark.slow
def test_the_first_run_is_anchored_and_draws_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    matplotlib.use("agg")
    from matplotlib import pyplot

    try:
        names = run(FIRST_RUN)
        figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
        plan, error, deviations = (figure.axes[0] for figure in figures)
    finally:
        pyplot.close("all")
    result, told = names["result"], capsys.readouterr().out
    assert result.anchored and len(names["scans"]) == len(names["updates"]) == 600 >= len(result.trajectory) > 580
    assert np.sqrt(np.mean(names["errors"] ** 2)) < 0.02
    live = [update.anchored for update in names["updates"]]
    assert not live[0] and live[-1] and sum(live) > 300  # so the page has both frames to show
    assert "s: anchored\n" in told and "m in the map, known to" in told and "m in the building, known to" in told
    assert "outside its limit" not in told
    assert sum(entry["significant"] for entry in result.deviations) <= 1  # one wall is seen from afar, at 2.7 sigma
    walls = len(plan.lines) - 3
    assert {"truth", "final"} < {line.get_label() for line in plan.lines} and walls > 60
    assert len(error.lines) == 2 and len(deviations.lines) == walls + len(names["moved"])
    assert (tmp_path / "sgslam_first_run/out/report.html").is_file()
    assert (tmp_path / "sgslam_first_run/out/report.html").as_posix() in told
