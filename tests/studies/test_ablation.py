"""The ablation: its runs on a user's own sequence, and its tables, plots and claims."""

from pathlib import Path

import pandas as pd
import pytest
from drives import SENSOR
from small_ifc import STOREY, write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from data.simulation.simulate import simulate
from evaluation.drives import Conditions, SequenceSpec, prepare, read_specs
from evaluation.slam_ablation.scores import CURVE, Scores
from evaluation.slam_ablation.study import STUDY, Choice, Run, cases, measure
from evaluation.slam_ablation.tables import prepared

VARIANTS = ("kiss-icp", "small_gicp", "graph", "oracle")


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    """A short drive as a user's own scans and truth."""
    folder = tmp_path_factory.mktemp("own")
    building = write_small_ifc(folder / "small.ifc")
    simulate(building.path, STOREY, folder / "drive", seed=1, min_rooms=1, min_length=6.0, sensor=SENSOR)
    scans, truth = folder / "drive" / "scans", folder / "drive" / "truth.tum"
    return SequenceSpec(name="own", bim=str(building.path), scans=str(scans), truth=str(truth))


def run(spec: SequenceSpec, variant: str, conditions: Conditions = Conditions(), seed: int = 0) -> Run:  # noqa: B008
    return Run(sequence=spec, seed=seed, conditions=conditions, variant=variant)


@pytest.fixture(scope="module")
def measured(own: SequenceSpec, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scores]:
    work = tmp_path_factory.mktemp("work")
    return {variant: measure(run(own, variant), work) for variant in VARIANTS}


@pytest.mark.slow
def test_records_say_how_it_went(measured: dict[str, Scores]) -> None:
    kiss, small_gicp, graph, oracle = measured.values()
    assert oracle.anchored and oracle.rmse_m is not None and oracle.rmse_m < 0.03
    assert not graph.anchored and graph.rmse_m is not None and graph.rmse_m < 0.05
    for peer in (kiss, small_gicp):
        assert not peer.anchored and peer.rmse_m is not None and peer.rmse_m < 0.5 and peer.wall_precision is None
    for own in measured.values():
        assert own.matched_poses == own.poses > 50 and 6.0 < own.driven_m < 40.0
        assert own.peak_memory_mb is not None and 30 < own.peak_memory_mb < 4000
        assert own.rmse_m is not None and own.max_m is not None and own.seconds is not None
        assert 0 < len(own.errors_m) == len(own.times_s) <= CURVE
        assert own.rmse_m / 2 < sum(own.errors_m) / len(own.errors_m) and max(own.errors_m) <= own.max_m + 1e-4
    assert oracle.wall_precision is not None and oracle.wall_precision > 0.5
    assert oracle.match_precision is not None and oracle.match_precision > 0.9
    stages = (oracle.seconds_odometry, oracle.seconds_surfaces, oracle.seconds_matching, oracle.seconds_optimisation)
    assert oracle.seconds is not None and 0 < sum(stage or 0.0 for stage in stages) <= oracle.seconds


@pytest.mark.slow
def test_tables_plots_and_claims_of_runs(own: SequenceSpec, measured: dict[str, Scores], tmp_path: Path) -> None:
    rows = rows_of((run(own, variant), record) for variant, record in measured.items())
    reduction = prepared(rows).set_index("variant").drift_reduction
    oracle, graph = measured["oracle"].rmse_m, measured["graph"].rmse_m
    assert oracle is not None and graph is not None
    assert reduction["oracle"] == pytest.approx(100 * (1 - oracle / graph)) and reduction.isna().sum() == 3
    found = STUDY.tables(rows)
    regions = found["regions"].set_index("variant")
    assert regions.index.tolist() == ["oracle"] and regions.poses["oracle"] == str(measured["oracle"].poses)
    assert found["map"].variant.tolist() == ["graph", "oracle"]
    assert found["cost"].seconds.astype(float).gt(0).all()
    STUDY.plots(rows, tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"ablation-error-own-normal.svg", "ablation-drift-reduction.svg"}
    before = {name: (tmp_path / name).read_bytes() for name in names}
    STUDY.plots(rows, tmp_path)
    assert before == {name: (tmp_path / name).read_bytes() for name in names}


@pytest.mark.slow
def test_what_a_run_refuses_reaches_the_user(own: SequenceSpec, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="not simulated"):
        measure(run(own, "graph", Conditions(moved_walls=0.3)), tmp_path)


@pytest.mark.long
@pytest.mark.slow
def test_a_weak_front_end_has_an_odometry_of_its_own(
    own: SequenceSpec, measured: dict[str, Scores], tmp_path: Path
) -> None:
    weaken = Conditions(weaken=True)
    sequence = prepare(own, 0, tmp_path, weaken)
    assert sequence.weak is not None and len(sequence.weak.trajectory) == len(sequence.truth)
    (kept,) = tmp_path.glob("own-odometry/odometry-*.tum")
    before = kept.stat().st_mtime_ns
    again = prepare(own, 0, tmp_path, weaken)
    assert again.weak is not None and again.weak.rmse_m == sequence.weak.rmse_m > 0.5
    assert kept.stat().st_mtime_ns == before
    assert prepare(own, 0, tmp_path).weak is None
    record, whole = measure(run(own, "graph", weaken), tmp_path), measured["graph"]
    assert record.rmse_m is not None and whole.rmse_m is not None and record.rmse_m > whole.rmse_m
    assert STUDY.tables(rows_of([(run(own, "graph", weaken), record)]))["weakened"].weakening.item() == record.weakening


def test_list_of_sequences(tmp_path: Path) -> None:
    path = tmp_path / "list.yaml"
    path.write_text("- name: a\n  bim: a.ifc\n  storey: Ground\n- {name: b, bim: b.json, scans: s, truth: t.tum}\n")
    first, second = read_specs(path)
    assert (first.storey, first.scans, second.truth) == ("Ground", None, "t.tum")
    chosen = cases(Choice(listed=path, sequences=(), seeds=(0, 1), variants=("graph",), loops=True))
    assert [(case.sequence.name, case.seed) for case in chosen] == [("a", 0), ("a", 1), ("b", 0)]
    assert all(case.conditions == Conditions(loops=True) for case in chosen)
    path.write_text("- {name: a, bim: mesh.stl}")
    assert read_specs(path)[0].is_mesh
    for text, what in (
        ("- {name: a, bim: a.ifc, scans: s}", "truth"), ("- {name: a, bim: a.ifc}", "storey"), ("name: a", "list"),
        ("- {name: a, bim: a.ifc, storey: G, colour: red}", "colour"), ("- {name: [", "YAML"),
        ("- {name: a, bim: demo}\n- {name: a, bim: demo}", "same name"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(UserError, match=what):
            read_specs(path)


def rows_with(errors: dict[str, list[float | None]], driven: float = 50.0) -> pd.DataFrame:
    """Runs of variants with these errors, one a seed."""
    demo = SequenceSpec(name="demo", bim="demo")
    record = Scores(anchored=False, poses=10, driven_m=driven, seconds=150.0, seconds_reading=1.0, peak_memory_mb=200.0)
    return rows_of(
        (
            run(demo, variant, seed=seed),
            record.model_copy(
                update={"rmse_m": error, "anchored": error is not None, "matched_poses": 0 if error is None else 9}
            ),
        )
        for variant, own in errors.items()
        for seed, error in enumerate(own)
    )


def test_tables_give_mean_and_deviation_over_the_seeds() -> None:
    own: list[float | None] = [0.01, 0.02, 0.03]
    found = STUDY.tables(rows_with({"graph": [0.1, 0.1, 0.1], "anchored": own, "oracle": [0.01, 0.01, 0.01]}))
    line = found["accuracy"].set_index("variant").loc["anchored"]
    assert (line["runs"], line["anchored"], line["coverage"]) == ("3", "3/3", "27/30")
    assert line["RMSE (m)"] == "0.02 ± 0.01" and line["drift reduction (%)"] == "80 ± 10"
    assert found["cost"].seconds[0] == "150 ± 0" and found["lengths"] == "50 to 50"
    assert found["oracle"].to_numpy().tolist() == [["demo", "normal", "anchored", "0.0200", "0.0100", "+100 %"]]
    assert list(found["readme"].iloc[0]) == [
        "demo building, ground floor", *(f"{error} m over 27/30 scans" for error in ("0.100", "0.020", "0.010")),
    ]  # fmt: skip


def test_runs_that_are_not_anchored_are_told() -> None:
    rows = rows_with({"icp-to-bim": [0.2, 0.2, 0.4], "anchored": [0.01, None, 0.03], "anchored:voting": [None] * 3})
    readme = STUDY.tables(rows)["readme"].iloc[0]
    assert readme["**ours, anchored**"] == "0.020 m over 18/20 scans (2 of 3 anchored)"
    assert readme["ours, matched by voting"] == "(0 of 3 anchored)"
    anchored, rmse, relative = STUDY.claims(rows)
    assert rmse.value.startswith("20.0 [") and rmse.cases == "3 drives, 1 buildings, 18/20 scans"
    assert anchored.value == "2 of 3 (≥ 9 %)"  # Clopper and Pearson
    assert relative.value.startswith("0.067 [") and relative.cases == "2 drives, 1 buildings"


def test_unknown_variants_are_refused() -> None:
    unknown, no_method = "unknown variant", "no matching method"
    for variant, what in (("fast", unknown), ("oracle:x", unknown), ("anchored:", unknown), ("anchored:x", no_method)):
        with pytest.raises(UserError, match=what):
            cases(Choice(variants=(variant,)))


def test_conditions_are_told_by_their_names() -> None:
    assert Conditions().name == "normal" and Conditions().of_the_drive == ""
    hard = Conditions(weaken=True, moved_walls=0.33, wrong_matches=2, loops=True)
    assert hard.name == "weaken moved-walls-0.33 wrong-matches-2 loops"
    assert hard.of_the_drive == "-moved_walls0.33-loops"
    with pytest.raises(ValueError, match="moved_walls"):
        Conditions(moved_walls=2.0)
