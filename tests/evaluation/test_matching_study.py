"""The study of matching: which maps there are, what becomes of a match, and what is claimed of it."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plans import a_graph, flat
from shapely.geometry import Polygon, mapping

from data import SceneGraph, WallSurface
from data.common.errors import UserError
from data.common.files import write_json
from data.geometry import se2
from data.plans import Plan
from data.synthetic_maps.noise_models import draw
from evaluation.drive import DriveCase, drive_of
from evaluation.maps import written
from evaluation.matching.methods import trained_on
from evaluation.matching.own_maps import own_maps
from evaluation.matching.pairs import Candidate, KnownMap, MatchCase, described, known_maps, pairs_of_cell
from evaluation.matching.scores import answered, score
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.metrics.true_matches import TrueMatches
from evaluation.rows import Provenance, Row
from evaluation.studies.matching import STUDY, Choice, cases, measure
from evaluation.tables import frame
from matching import MatchResult
from matching.matcher import DEFAULT
from matching.training.slam_maps import MapInPlan

SEEDS = (3, 4, 17, 22)  # the first two houses are for training by their names, the others for tests
WALLS = tuple(WallSurface(name, None, (0.0, 0.0), (1.0, 0.0), 1.0) for name in ("one", "two", "cupboard", "shelf"))
S = SceneGraph("map", (), WALLS)
TRUTH = TrueMatches({}, {"one": "a", "two": "b"}, (0.0, 0.0, 0.0), None, (0.0, 0.0))
MIXED = MatchResult("unique", "", (), (("one", "a", 0.97), ("two", "c", 0.91), ("shelf", "a", 0.2)), (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plans") / "msd"  # the set that is perturbed as published
    folder.mkdir()
    for seed in SEEDS:
        rooms = [{"name": "room", "polygon": mapping(Polygon(room))} for room in flat(np.random.default_rng(seed))]
        write_json(folder / f"flat_{seed}.json", {"name": f"flat_{seed}", "unit": "m", "elements": {}, "rooms": rooms})
    return folder


def choice(folder: Path, **changes: Any) -> Choice:
    small = {"plans": [str(folder)], "generated": [], "buildings": [], "published_map": "", "methods": ["voting"]}
    return Choice.model_validate({**small, "regimes": ["real"], "rooms": [2, "all"], "pairs": 4, **changes})


def known_of(folder: Path, **changes: Any) -> KnownMap:
    case = MatchCase(**{"plans": str(folder), "plan": "flat_17", "regime": "perturbed", **changes})
    return known_maps(case, folder)[0]


def off_the_truth(known: KnownMap) -> float:
    s = known.drawn.s_graph
    fit = best_rigid_fit(s, known.a_graph.on_floor(known.drawn.floor), known.drawn.wall_surfaces)
    return float(np.hypot(*(se2.apply(fit, s.centroid()) - se2.apply(np.array(known.truth.T_a_s), s.centroid()))))


def test_pairs_depend_neither_on_the_order_of_the_plans_nor_on_how_many_are_wanted() -> None:
    graphs = {seed: a_graph(flat(np.random.default_rng(seed)), "ground") for seed in range(3, 7)}
    plans = [Candidate("flats", Plan(f"flat_{seed}", f"house_{seed}", graph)) for seed, graph in graphs.items()]
    for regime in ("real", "negative"):
        few, many = (pairs_of_cell(plans[::step], regime, 3, n, 0) for step, n in ((1, 6), (-1, 8)))
        assert many[:6] == few and {pair.plan for pair in few} == {one.plan.name for one in plans}
        assert all((pair.source is not None and pair.source[1] != pair.plan) == (regime == "negative") for pair in many)
    # No plan is so large; another set than that of the paper; no other building.
    for some, regime, rooms in ((plans, "real", 500), (plans, "perturbed", None), (plans[:1], "negative", 2)):
        assert pairs_of_cell(some, regime, rooms, 3, 0) == []


def test_a_case_says_what_map_it_is_and_methods_share_it(folder: Path) -> None:
    every = cases(choice(folder, methods=["voting", "oracle"], regimes=["real", "negative"]))
    assert [MatchCase.model_validate_json(case.key) for case in every] == every
    assert {case.method for case in every if case.regime == "negative"} == {"voting"}  # there is no true place
    assert {case.group for case in every[:2]} == {every[0].group} != {every[2].group}


@pytest.mark.parametrize("regime", ["real", "perturbed", "perturbed and shifted"])
def test_the_true_walls_lie_where_the_truth_places_the_map(folder: Path, regime: str) -> None:
    known = known_of(folder, regime=regime)
    assert len(known.truth.wall_surfaces) > 8 and off_the_truth(known) < 0.15
    assert (np.hypot(*known.truth.T_a_s[1:]) < 0.1) == (regime == "perturbed")  # turned about the plan's origin


def test_plans_that_anything_was_chosen_by_are_named_so(folder: Path, tmp_path: Path) -> None:
    def role(plans: str, plan: str, trained: tuple[str, ...] = (), regime: str = "real") -> str:
        return described(MatchCase(plans=plans, plan=plan, regime=regime), trained)["role"]

    seeds = (899_999, 900_000, 901_999, 902_000)
    assert [role("generated", f"office_{n}")[:4] for n in seeds] == ["trai", "deve", "deve", "test"]
    assert role("sgslam", "generated/office_21", regime="sgslam") == "training"
    assert role("sgslam", "institute", regime="sgslam") == "development"
    network, names = tmp_path / "paper.safetensors", [f"flat_{seed}" for seed in SEEDS]
    network.touch()
    write_json(tmp_path / "model_card.json", {"data": {"files": ["../plans/msd", "lifull.tar.gz"]}})
    assert trained_on(f"paper@{network}") == {"msd", "lifull"} and trained_on("paper") == set()
    for trained, roles in (((), ["test"] * 4), (("msd",), ["training", "training", "test", "test"])):
        assert [role(str(folder), name, trained) for name in names] == roles
    shutil.copytree(folder, tmp_path / "swiss_floors")
    assert role(str(tmp_path / "swiss_floors"), "flat_3") == "development"


def test_the_scores_of_an_answer_by_hand() -> None:
    found, nowhere = score(MIXED, TRUTH, S, False), replace(TRUTH, wall_surfaces={})
    assert found["wall"] == found["node"] == {"precision": 1 / 3, "recall": 1 / 2, "f1": pytest.approx(0.4)}
    assert found["room"]["f1"] is None and [one[:3] for one in found["bins"]] == [(4, 1, 0), (18, 1, 0), (19, 1, 1)]
    assert (
        score(MIXED, nowhere, S, False)["wrong"] and not found["wrong"]
    )  # every unique answer is wrong where nothing of the map is planned


def test_what_is_late_or_raises_is_no_answer(folder: Path) -> None:
    known = known_of(folder, regime="real")
    found, late = (answered(known, "voting", limit_s) for limit_s in (60.0, 1e-6))
    raised = answered(replace(known, a_graph=None), "voting", 60.0)  # type: ignore[arg-type]
    assert found["wall"]["recall"] > 0.8 and late["wall"]["recall"] == raised["wall"]["recall"] == 0.0
    assert (late["answer"], raised["answer"]) == ("late", "raised") and "NoneType" in raised["reason"]


def test_tables_and_claims_are_of_rows_by_their_roles(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "swiss_floors")
    every = cases(choice(folder, regimes=["real", "negative", "perturbed"])) + cases(choice(tmp_path / "swiss_floors"))
    made = Provenance(build="", commit="", command="", machine="", date="")
    named = [case.model_dump(mode="json") | {"method": DEFAULT} for case in every]  # whose results are claimed
    rows = frame([Row(name, measure(case, tmp_path), made) for name, case in zip(named, every, strict=True)])
    found = STUDY.tables(rows)
    f1, of_nowhere = found["methods"]["wall F1"]
    assert 0.6 < float(f1) < 1.0 and of_nowhere == ""
    assert found["sets"][["role", "maps"]].to_numpy().tolist() == [["test", "8"], ["development", "8"]]
    assert found["published"].method.tolist()[4:] == [DEFAULT] and float(found["published"].F1.iloc[-1]) > 0.9
    assert STUDY.claims(rows)[0].units == "8 maps, 4 buildings"


def test_a_published_map_is_read_with_its_matches_and_mistakes_are_named(folder: Path, tmp_path: Path) -> None:
    plan = a_graph(flat(np.random.default_rng(5)), "ground")
    drawn = draw(plan, "real", np.random.default_rng(0), 4)
    matches = {"rooms": [*drawn.rooms.items()], "wall_surfaces": [*drawn.wall_surfaces.items()]}
    value = {"s_graph": drawn.s_graph.to_dict(), "a_graph": plan.to_dict(), "matches": matches}
    write_json(tmp_path / "map.json", value)
    known = known_of(tmp_path / "map.json", regime="published map", plan="")
    assert known.truth.floor == drawn.floor and off_the_truth(known) < 1e-6
    write_json(tmp_path / "bad.json", {**value, "matches": {}})
    with pytest.raises(UserError, match=r"bad\.json: needs s_graph"):
        known_of(tmp_path / "bad.json", regime="published map", plan="")
    for option, wrong in (("methods", "magic"), ("generated", "castle_2"), ("generated", "office")):
        with pytest.raises(UserError, match=wrong):
            cases(choice(folder, **{option: [wrong]}))


@pytest.mark.long
def test_the_system_s_own_maps_lie_where_the_truth_says(tmp_path: Path) -> None:
    case = DriveCase(building="generated/apartment_902000", seconds=20.0)
    drawn, plan = own_maps(case, tmp_path)
    assert drawn and all(one.s_graph.frame == "map" for one in drawn)  # not its mirror image
    assert len(drawn[-1].wall_surfaces) > 0.7 * len(drawn[-1].s_graph.wall_surfaces)
    assert off_the_truth(KnownMap(drawn[-1], plan)) < 0.2
    kept = [MapInPlan.load(path) for path in written(case, drive_of(case, tmp_path), tmp_path)]
    assert len(kept) > 2 and {one.floor for one in kept} == {drawn[-1].floor}
    assert all(np.allclose(one.T_a_s, drawn[-1].T_a_s, atol=0.2) for one in kept)
