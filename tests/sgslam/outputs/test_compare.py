"""Two runs in one building, compared by their elements."""

import json
from pathlib import Path
from typing import Any

import pytest

from data.common.errors import UserError
from sgslam.as_built.compare import compare, main


def _entry(name: str, verdict: str, offset: float | None = None) -> dict[str, Any]:
    return {
        "global_id": name, "name": name, "ifc_class": "IfcWall", "storey": "Ground", "verdict": verdict,
        "offset_m": offset, "sigma_m": None if offset is None else 0.005,
        "direction": None if offset is None else [1.0, 0.0, 0.0],
    }  # fmt: skip


def _run(path: Path, *entries: dict[str, Any]) -> Path:
    path.mkdir()
    (path / "elements.json").write_text(json.dumps({"elements": entries}))
    return path


@pytest.mark.parametrize(
    ("old", "new", "change"),
    [
        (("absent",), ("as planned", 0.0), "built since"),
        (("absent",), ("absent",), "still absent"),
        (("as planned", 0.0), ("absent",), "gone since"),
        (("as planned", 0.002), ("moved", 0.04), "moved since"),
        (("as planned", 0.029), ("moved", 0.031), None),
        (("absent",), ("not seen",), None),
        (("not seen",), ("absent",), None),
    ],
)
def test_each_change(old: tuple[Any, ...], new: tuple[Any, ...], change: str | None, tmp_path: Path) -> None:
    runs = _run(tmp_path / "a", _entry("w", *old)), _run(tmp_path / "b", _entry("w", *new))
    assert [row["change"] for row in compare(*runs)] == ([] if change is None else [change])


def test_the_files_are_written_beside_the_later_run(tmp_path: Path) -> None:
    runs = _run(tmp_path / "a", _entry("w", "absent")), _run(tmp_path / "b", _entry("w", "as planned", 0.0))
    assert main([str(run) for run in runs]) == 0
    assert json.loads((runs[1] / "compare.json").read_text())[0]["after"] == "as planned"
    assert "built since,w,w,IfcWall" in (runs[1] / "compare.csv").read_text()


def test_other_plans_and_runs_without_elements_are_refused(tmp_path: Path) -> None:
    run = _run(tmp_path / "a", _entry("w", "absent"))
    with pytest.raises(UserError, match="their elements differ"):
        compare(run, _run(tmp_path / "b", _entry("v", "absent")))
    (tmp_path / "c").mkdir()
    with pytest.raises(UserError, match=r"no elements\.json"):
        compare(run, tmp_path / "c")
