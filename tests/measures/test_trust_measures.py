"""The measurement of trust: plans of other buildings."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from drives import Drive, small_drive
from study_rows import rows_of

from data import UserError
from data.generation.buildings import generate_plan
from evaluation.drives.sequences import SequenceSpec
from evaluation.studies.negative_plans import Choice, cases, claims, measure, tables


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


def choice(folder: Path, *names: str) -> Choice:
    listed = [
        SequenceSpec(
            name=name, bim=str(folder / f"{name}.json"), scans=str(folder / "scans"), truth=str(folder / "truth.tum")
        ).model_dump() for name in names
    ]  # fmt: skip
    (folder / "list.yaml").write_text(yaml.safe_dump(listed))
    return Choice(listed=folder / "list.yaml", seeds=(0, 1))


@pytest.mark.slow
def test_a_drive_is_run_with_every_plan_but_its_own(folder: Path, tmp_path: Path) -> None:
    own, other = cases(choice(folder, "own", "other"))  # recorded: one seed
    assert own.files() == {str(folder / name) for name in ("own.json", "other.json", "scans", "truth.tum")}
    right, wrong = measure(own, tmp_path), measure(other, tmp_path)
    assert (own.sequence.name, own.plan.name, right.anchored_scans) == ("own", "other", 0)
    assert right.none + right.ambiguous > 0 and right.unique == 0
    assert right.reason.startswith(("the plan does not explain the map", "too little evidence at the best place"))
    # the same drive, said to be of another building: there the table must tell
    assert (other.sequence.name, other.plan.name) == ("other", "own") and wrong.anchored_scans > 10
    rows = rows_of([(own, right), (other, wrong)])
    table = tables(rows)["pairings"]
    assert table.anchored.tolist() == ["never", f"**for {wrong.anchored_scans} scans**"]
    assert f"{wrong.unique} unique" in table.answers[1] and "unique" not in table.answers[0]
    assert claims(rows)[0].value.startswith("1 of 2 ")


def test_one_building_has_no_other(folder: Path) -> None:
    with pytest.raises(UserError, match="only one building"):
        cases(choice(folder, "own"))
