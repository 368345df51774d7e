"""The matching benchmark: which pairs there are, and what becomes of a match."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from plans import a_graph, flat

from data.common.files import write_json
from data.plans import Plan
from data.plans.splits import split_of
from data.synthetic_maps.noise_models import draw
from evaluation.drives.slam_graph_files import SlamDrive, SlamGraph, write_drive
from evaluation.harness.row_file import read_rows, rows_path
from evaluation.harness.running import Place, run_study
from evaluation.harness.tables import frame
from evaluation.matching_benchmark import judge
from evaluation.matching_benchmark.judge import judged
from evaluation.matching_benchmark.pairs import Prepared, pairs_of_cell, prepared, slam_pairs
from evaluation.matching_benchmark.plan_sets import Candidate
from evaluation.matching_benchmark.records import BenchmarkCase
from evaluation.matching_benchmark.study import STUDY, Choice, cases
from matching.published.baselines import WEIGHTS
from matching.result import MatchResult


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plans") / "flats"
    folder.mkdir()
    for seed in range(3, 7):
        a_graph(flat(np.random.default_rng(seed)), "ground").save(folder / f"flat_{seed}.json")
    return folder


def choice(folder: Path, **changes: object) -> Choice:
    plans = [folder / f"flat_{seed}.json" for seed in (3, 4)]
    small = {"plans": plans, "generated": [], "slam_graphs": None, "methods": ["voting", "oracle"], "pairs": 4}
    return Choice.model_validate({**small, "regimes": ["real", "negative"], "rooms": [2, "all"], **changes})


@pytest.mark.long
@pytest.mark.slow
def test_the_rows_of_a_run_are_tabulated_and_plotted(folder: Path, tmp_path: Path) -> None:
    options = choice(folder, plans=[*choice(folder).plans, folder / "nowhere.json"])
    run_study(STUDY, options, True, Place(tmp_path, tmp_path, jobs=2), "test")
    written = read_rows(rows_path(tmp_path, "matching"))
    assert len(written) == 4 * (2 * 2 + 2)  # no oracle where there is no truth; the missing plan is skipped
    here = {case.key: judged(case.pair.prepare(), case.method, 60.0) for case in cases(choice(folder))}
    without = {"seconds"}
    assert {row.key: {**row.record, "seconds": None} for row in written} == {
        key: {**record.model_dump(mode="json", exclude=without), "seconds": None} for key, record in here.items()
    }
    rows = frame(written)
    table = STUDY.tables(rows)["wall_f1_test_small"]
    assert table[["regime", "method", "pairs a cell"]].to_numpy().tolist() == [
        ["real", "voting", "4"], ["real", "oracle", "4"]
    ]  # fmt: skip
    STUDY.plots(rows, tmp_path)
    assert {path.name for path in tmp_path.glob("*.svg")} == {
        "matching-f1.svg", "matching-reliability.svg", "matching-time.svg"
    }  # fmt: skip


def test_a_case_is_complete_in_itself_and_the_methods_of_a_pair_are_neighbours(folder: Path) -> None:
    every = cases(choice(folder, pairs_of={"oracle": 2}))
    assert [BenchmarkCase.model_validate_json(case.key) for case in every] == every
    real = [case for case in every if case.pair.regime == "real" and case.pair.rooms == 2]
    assert [case.method for case in real] == ["voting", "oracle", "voting", "oracle", "voting", "voting"]
    assert real[0].pair == real[1].pair != real[2].pair
    negative = next(case for case in every if case.pair.regime == "negative")
    assert {Path(file).stem for file in negative.files()} == {"flat_3", "flat_4"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("regimes=[dreamt]", "regimes"),
        ("methods=[magic]", "no matching method 'magic'"),
        ("rooms=[two]", "rooms"),
        ("pairs=0", "pairs"),
        ("generated=['castle:2']", "castle:2"),
    ],
)
def test_a_users_mistake_is_one_line(tmp_path: Path, change: str, message: str) -> None:
    words = ["run", "matching", "--quick", "--rows", tmp_path, "--work", tmp_path, "--set", change]
    assert message in refused("evaluation.__main__", *words)


def candidates() -> list[Candidate]:
    graphs = {seed: a_graph(flat(np.random.default_rng(seed)), "ground") for seed in range(3, 7)}
    return [Candidate("flats", Plan(f"flat_{seed}", f"house_{seed}", graph)) for seed, graph in graphs.items()]


def test_pairs_depend_neither_on_the_order_of_the_plans_nor_on_how_many_pairs_are_wanted() -> None:
    plans = candidates()
    own = {c.plan.name: c.plan for c in plans}
    for regime in ("real", "negative"):
        few, many = (pairs_of_cell(plans[::step], regime, 3, n, 0) for step, n in ((1, 6), (-1, 8)))
        assert many[:6] == few
        drawn = [pair.drawn_from(own[pair.source[1] if pair.source else pair.plan]) for pair in few]
        assert drawn[0] != drawn[4]  # the same plan again, another map
        assert {pair.plan for pair in few} == set(own)
        assert all((pair.source is not None and pair.source[1] != pair.plan) == (regime == "negative") for pair in many)
    assert pairs_of_cell(plans, "real", 500, 3, 0) == []  # no plan is so large
    assert pairs_of_cell(plans[:1], "negative", 2, 3, 0) == []  # there is no other building


def test_no_building_that_a_network_was_trained_on_tests_it(tmp_path: Path) -> None:
    of_seed = {seed: tmp_path / f"flat_{seed}.json" for seed in (3, 4, 17, 22)}
    for seed, path in of_seed.items():
        a_graph(flat(np.random.default_rng(seed)), "ground").save(path)
    assert [split_of(path.stem) for path in of_seed.values()] == ["train", "train", "test", "test"]
    network, plans = tmp_path / "learned.npz", list(of_seed.values())
    shutil.copy(WEIGHTS / "learned.npz", network)
    options = choice(tmp_path, plans=plans, methods=["voting", f"learned@{network}"], regimes=["real"])
    for files, tested in ((["others.tar.gz"], {3, 4, 17, 22}), ([path.name for path in plans], {17, 22})):
        write_json(tmp_path / "model_card.json", {"data": {"files": files}})
        assert {case.pair.plan for case in cases(options)} == {f"flat_{seed}" for seed in tested}


def test_the_maps_of_our_own_pipeline_are_pairs_by_the_rooms_they_saw(tmp_path: Path) -> None:
    plan = a_graph(flat(np.random.default_rng(5)), "ground")
    drawn = [draw(plan, "real", np.random.default_rng(n), n) for n in (2, 5, 8)]
    for sequence in ("one", "two"):
        graphs = tuple(SlamGraph(float(n), n == 2, of) for n, of in enumerate(drawn))
        write_drive(tmp_path, SlamDrive(sequence, 0, plan, graphs), "house")
    pairs = slam_pairs(tmp_path)
    assert [(p.plan, p.rooms) for p in pairs] == [(s, n) for s in ("one", "two") for n in (2, 4, None)]
    records = [judged(prepared(pair), method, 60.0) for pair in pairs for method in ("voting", "oracle")]
    assert {record.building for record in records} == {"one"}  # two drives of one building
    assert sum(r.wall_tally.right for r in records) > 0.8 * sum(r.wall_tally.true for r in records)


def test_the_limit_of_time_holds_and_a_failure_is_a_record(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = Prepared.of(draw(candidates()[0].plan.graph, "real", np.random.default_rng(0), 3), candidates()[0].plan)

    def fails(pair: Prepared) -> MatchResult:
        raise ValueError("three is\ntoo many")

    def sleeps(pair: Prepared) -> MatchResult:
        time.sleep(60)
        return MatchResult("none", "")

    methods: dict[str, Callable[[Prepared], MatchResult]] = {"fails": fails, "sleeps": sleeps}
    monkeypatch.setattr(judge, "load_method", methods.__getitem__)
    failed, late = judged(pair, "fails", 5.0), judged(pair, "sleeps", 0.2)
    assert (failed.status, failed.reason) == ("failed", "ValueError: three is")
    assert (late.status, late.reason, late.seconds) == ("late", "stopped after 0.2 s", 0.2)
    assert late.wall_tally.true > 10 and late.wall_tally.answered == 0
