"""The measurement of trust: plans of other buildings."""

from pathlib import Path

import numpy as np
import pytest
from drives import Drive, small_drive

from data import UserError
from data.generation.buildings import generate_plan
from evaluation.harness import SequenceSpec
from evaluation.studies import negative_plans


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


@pytest.fixture(scope="module")
def folder(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its scans, truth and plan as files."""
    out = tmp_path_factory.mktemp("drive")
    (out / "scans").mkdir()
    for k, (_, points) in enumerate(drive.scans):
        np.save(out / "scans" / f"{k:06d}.npy", points.astype(np.float32))
    stamps = "".join(f"{stamp / 1e9:.3f}\n" for stamp, _ in drive.scans)
    (out / "scans" / "times.txt").write_text(stamps)
    drive.truth.write_tum(out / "truth.tum")
    drive.bim.graph.save(out / "own.json")
    generate_plan("apartment", 3).graph.save(out / "other.json")
    return out


def spec(folder: Path, name: str) -> SequenceSpec:
    scans, truth = folder / "scans", folder / "truth.tum"
    return SequenceSpec(name, str(folder / f"{name}.json"), scans=str(scans), truth=str(truth))


@pytest.mark.slow
def test_a_drive_is_run_with_every_plan_but_its_own(folder: Path, tmp_path: Path) -> None:
    own, other = spec(folder, "own"), spec(folder, "other")
    found = list(negative_plans.pairings([own, other], [0], tmp_path))
    first, last = found
    assert (first.sequence, first.plan, first.anchored_scans) == ("own", "other", 0)
    assert first.answers and "unique" not in first.answers
    assert first.reason.startswith(("the plan does not explain the map", "too little evidence at the best place"))
    # the same drive, said to be of another building: there the table must tell
    assert (last.sequence, last.plan) == ("other", "own") and last.anchored_scans > 10
    text = negative_plans.table(found)
    assert "Anchored at any time: 1 of 2 pairings." in text
    assert f"**for {last.anchored_scans} scans**" in text and "| never |" in text


def test_one_building_has_no_other(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="only one building"):
        list(negative_plans.pairings([spec(folder, "own")], [0], tmp_path))
