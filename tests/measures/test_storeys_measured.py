"""The tables of drives over storeys and of starts on each."""

from dataclasses import replace

from evaluation.studies.storeys import Row, table

CLIMB = Row(
    building="house", storeys=("ground", "first"), seed=1, status="unique", length_m=80.0, entered=7,
    wrong_storey=False, wrong_place=False, unique_m=12.0, unique_rooms=3, floors=2,
    rooms=9, on_their_floor=8, rmse_m=0.0123, max_m=0.2,
    stair_rmse_m=0.05,
)  # fmt: skip


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_each_drive_over_stairs_has_its_line() -> None:
    lost = replace(CLIMB, seed=2, rmse_m=None, max_m=None, stair_rmse_m=None, wrong_storey=True)
    lines = table([CLIMB, lost]).splitlines()
    assert cells(lines[2])[:7] == ["house", "ground, first", "1", "80", "2", "8/9", "0.0123"]
    assert cells(lines[3])[6] == "not anchored" and cells(lines[3])[-1] == "yes"


def test_starts_are_counted_storey_by_storey() -> None:
    start = replace(CLIMB, storeys=("ground",))
    never = replace(start, seed=2, unique_m=None, unique_rooms=None, status="ambiguous")
    wrong = replace(start, storeys=("first",), unique_m=30.0, unique_rooms=5, wrong_storey=True, wrong_place=True)
    lines = [cells(line) for line in table([start, never, wrong]).splitlines()]
    assert lines[2] == ["house", "ground", "2", "0", "0", "1", "3 (3 to 3)", "12 (12 to 12)", "1", "0"]
    assert lines[3] == ["house", "first", "1", "1", "1", "1", "5 (5 to 5)", "30 (30 to 30)", "0", "0"]
    assert lines[4][:6] == ["all", "", "3", "1", "1", "2"]
