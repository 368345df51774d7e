"""Two runs in one building, compared by their elements."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from report_samples import verdict

from data.common.errors import UserError
from sgslam.as_built.compare import compare, main
from sgslam.as_built.elements import Verdict

Told = tuple[Verdict, float | None]
ABSENT: Told = ("absent", None)
UNSEEN: Told = ("not seen", None)


def run_of(path: Path, told: Told, name: str = "w") -> Path:
    """The folder of a run with one wall."""
    path.mkdir()
    entry = asdict(verdict(name, *told))
    (path / "elements.json").write_text(json.dumps({"elements": [entry]}))
    return path


@pytest.mark.parametrize(
    ("old", "new", "change"),
    [
        (ABSENT, ("as planned", 0.0), "built since"),
        (ABSENT, ABSENT, "still absent"),
        (("as planned", 0.0), ABSENT, "gone since"),
        (("as planned", 0.002), ("moved", 0.04), "moved since"),
        (("as planned", 0.029), ("moved", 0.031), None),
        (ABSENT, UNSEEN, None),
    ],
)
def test_each_change_is_in_the_files_beside_the_later_run(
    old: Told, new: Told, change: str | None, tmp_path: Path
) -> None:
    runs = run_of(tmp_path / "a", old), run_of(tmp_path / "b", new)
    assert [row["change"] for row in compare(*runs)] == ([] if change is None else [change])
    assert main([str(run) for run in runs]) == 0
    assert [row["after"] for row in json.loads((runs[1] / "compare.json").read_text())] == [new[0]] * bool(change)
    assert (f"{change},Wall w,w,IfcWall" in (runs[1] / "compare.csv").read_text()) == bool(change)


def test_runs_with_other_plans_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="their elements differ"):
        compare(run_of(tmp_path / "a", ABSENT), run_of(tmp_path / "b", ABSENT, "v"))
