"""The tables of drives over storeys and of starts on each."""

from study_rows import rows_of

from evaluation.studies.storeys import Choice, StoreyDrive, Storeys, Tour, cases, claims, tables

CLIMB = StoreyDrive(
    bim="a/house.ifc", storeys=("ground", "first"), seed=1, carrier="pole", min_rooms=4, min_length=30.0,
    method="learned",
)  # fmt: skip
FOUND = Storeys(
    status="unique", length_m=80.0, entered=7, wrong_storey=False, wrong_place=False, unique_m=12.0, unique_rooms=3,
    floors=2, rooms=9, on_their_floor=8, rmse_m=0.0123, max_m=0.2, stair_rmse_m=0.05,
)  # fmt: skip
LOST = FOUND.model_copy(update={"rmse_m": None, "max_m": None, "stair_rmse_m": None, "wrong_storey": True})
PART = FOUND.model_copy(update={"coverage": 0.905})


def test_each_drive_over_stairs_has_its_line() -> None:
    rows = rows_of([(CLIMB, PART), (CLIMB.model_copy(update={"seed": 2}), LOST)])
    lines = tables(rows)["climbs"].astype(str).to_numpy().tolist()
    assert lines[0][:9] == ["house", "ground, first", "pole", "1", "80", "2", "8/9", "0.0123", "90.5 %"]
    assert lines[1][7:9] == ["not anchored", "-"] and lines[1][-1] == "yes"
    assert claims(rows)[1].cases == "1/2 drives anchored, coverage 90.5 %"
    before = rows.drop(columns="coverage")  # rows from when it was not kept
    assert tables(before)["climbs"].coverage.tolist() == ["-", "-"]
    assert [claim.value[:7] for claim in claims(rows)] == ["1 of 2 ", "12.3 [1"]


def test_starts_are_counted_storey_by_storey() -> None:
    start, first = (CLIMB.model_copy(update={"storeys": (storey,)}) for storey in CLIMB.storeys)
    never = FOUND.model_copy(update={"unique_m": None, "unique_rooms": None, "status": "ambiguous"})
    late = {"unique_m": 30.0, "unique_rooms": 5, "wrong_storey": True, "wrong_place": True}
    rows = rows_of([(start, FOUND), (start, never), (first, FOUND.model_copy(update=late))])
    lines = tables(rows)["starts"].astype(str).to_numpy().tolist()
    assert lines[0] == ["house", "ground", "2", "0", "0", "1", "3 (3 to 3)", "12 (12 to 12)", "1", "0"]
    assert lines[1] == ["house", "first", "1", "1", "1", "1", "5 (5 to 5)", "30 (30 to 30)", "0", "0"]
    assert lines[2][:6] == ["all", "", "3", "1", "1", "2"]
    assert tables(rows)["climbs"].empty


def test_a_tour_is_a_drive_over_all_storeys_or_a_start_on_each() -> None:
    tour = Tour(bim="own.ifc", storeys=("A", "B"), seeds=(3,))
    carried = tour.model_copy(update={"carriers": ("handheld", "pole")})
    drives = [(case.storeys, case.carrier) for case in cases(Choice(climbs=(carried,), starts=(tour,)))]
    both = ("A", "B")
    assert drives == [(both, "handheld"), (both, "pole"), (("A",), "wheeled"), (("B",), "wheeled")]
