"""All parts of one known map, moved anywhere."""

import json
from pathlib import Path

import numpy as np
import pytest
from known_maps import write_known_map
from plans import a_graph, flat
from study_rows import rows_of

from data.common.errors import UserError
from data.geometry import se2
from data.scene_graph.motion import moved
from data.synthetic_maps.noise_models import draw
from evaluation.published.known_map import Choice, PartCase, cases, claims, known_parts, measure, tables

pytestmark = pytest.mark.slow

PLAN = a_graph(flat(np.random.default_rng(5)), "ground")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_known_map(tmp_path / "known.json", PLAN, 4)


def test_every_part_under_every_motion_is_measured_against_its_own_truth(file: Path, tmp_path: Path) -> None:
    listed = cases(Choice(file=str(file), motions=2))
    assert len(known_parts(str(file))) == 6 + 4 + 1 and len(listed) == 2 * 11
    assert len({case.key for case in listed}) == 22
    assert all(PartCase.model_validate_json(case.key) == case for case in listed)
    found = [(case, measure(case, tmp_path)) for case in listed]
    assert not any(record.wrong for _, record in found)
    assert sum(record.status == "unique" for _, record in found) > 11
    whole = [record for _, record in found if record.s_rooms == 4]
    assert all(r.room_tally.right == 4 and r.wall_tally.right >= 0.9 * r.wall_tally.true for r in whole)

    rows = rows_of(found)
    table = tables(rows)["parts"]
    assert table.rooms.tolist() == [2, 3, 4, "all"] and table.matches.tolist() == ["12", "8", "2", "22"]
    assert (table["room F1"] == "1.000").all() and table.wrong.iloc[-1].startswith("0 of ")
    (claim,) = claims(rows)
    assert claim.value.startswith(f"{22 - (rows.status == 'unique').sum()} of 22 (≤ ")


def test_unique_answers_elsewhere_are_wrong(file: Path, tmp_path: Path) -> None:
    value = json.loads(file.read_text())
    for match in value["matches"]["rooms"]:
        match[1] = PLAN.rooms[0].id
    other = tmp_path / "other.json"
    other.write_text(json.dumps(value))
    found = [(case, measure(case, tmp_path)) for case in cases(Choice(file=str(other), motions=1))]
    unique = [record.wrong for _, record in found if record.status == "unique"]
    assert unique and all(unique)
    assert claims(rows_of(found))[0].value.startswith("11 of 11")


def test_a_moved_part_is_the_same_part() -> None:
    s = draw(PLAN, "real", np.random.default_rng(2), 4).s_graph
    T = np.array([2.0, 30.0, -7.0])
    back = moved(moved(s, T), se2.inverse(T))
    for of, there in zip(back.wall_surfaces, s.wall_surfaces, strict=True):
        assert of.centroid == pytest.approx(there.centroid) and of.normal == pytest.approx(there.normal)


def test_a_file_that_is_no_known_map_is_told_and_a_missing_one_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text('{"s_graph": 1}')
    with pytest.raises(UserError, match=r"bad\.json"):
        known_parts(str(tmp_path / "bad.json"))
    missing = str(tmp_path / "missing.json")
    assert [case.files() for case in cases(Choice(file=missing, motions=1))] == [{missing}]
