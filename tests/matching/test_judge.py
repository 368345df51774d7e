"""The judge of places: what it may never be sure of, what it is for, its weights, its training."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import refused
from methods import SMALL, as_map, matcher

from data import UserError
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.verdict import Signs, ranked
from matching.judge import Judge, judge, placements_of
from matching.result import MatchResult
from matching.train import main
from matching.training.judge import JudgeNetwork, JudgeTraining, judge_of, save_judge
from matching.training.judge_data import Examples, drawn_examples
from matching.training.slam_maps import MapInPlan
from matching.training.truth import RIGHT_M, generated, seeds_of

UNSEEN = seeds_of("test")  # nothing was trained or fitted on these buildings
KINDS = ("apartment", "office", "corridor", "mirrored_twins")


@pytest.fixture(scope="module")
def found() -> Hypotheses:
    walls = PlanWalls.of(SMALL)
    assert walls is not None
    drawn = draw(SMALL, "drift", np.random.default_rng(1), 2)
    return ranked(search(scene_of(drawn.s_graph, walls)))[0]


@pytest.fixture(scope="module")
def examples() -> Examples:
    return Examples.of(drawn_examples("train", 0, 0, 12))


def chances(found: Hypotheses) -> np.ndarray:
    return Judge.load()(found, Signs.of(found))


def maps(count: int, rooms: int) -> Iterator[tuple[str, DrawnGraph]]:
    for n in range(count):
        kind, rng = KINDS[n % len(KINDS)], np.random.default_rng(n)
        seeds = UNSEEN[kind]
        plan = generated(kind, seeds[n % len(seeds)]).graph
        yield kind, draw(plan, ("drift", "mis_segmented")[n % 2], rng, rooms)


def is_right(answer: MatchResult, drawn: DrawnGraph) -> bool:
    assert answer.matrix is not None
    middle = np.array([*drawn.s_graph.centroid(), 0.0, 1.0])
    true = replace(answer, T_a_s=drawn.T_a_s).matrix
    assert true is not None
    return bool(np.linalg.norm((answer.matrix - true) @ middle) < RIGHT_M and answer.floor == drawn.floor)


def test_equal_places_are_equally_probable_in_any_order(found: Hypotheses) -> None:
    assert len(found) > 2
    equal = chances(found[np.zeros(3, dtype=np.int64)])
    assert np.allclose(equal, equal[0], atol=1e-6) and equal.sum() <= 1.0 + 1e-9
    order = np.array([0, *range(len(found) - 1, 0, -1)])
    assert np.allclose(chances(found[order]), chances(found)[order], atol=1e-5)
    assert chances(found).min() >= 0.0 and chances(found).sum() <= 1.0 + 1e-9


def test_the_plan_of_another_building_is_not_unique() -> None:
    for n, (kind, drawn) in enumerate(maps(50, 4)):
        other = generated(kind, UNSEEN[kind][(n + 1) % len(UNSEEN[kind])]).graph
        assert matcher("learned").match(drawn.s_graph, other).status != "unique", (kind, n)


def test_it_decides_more_than_the_evidence_and_nothing_wrongly() -> None:
    decided = dict.fromkeys(("voting", "learned"), 0)
    for n, (kind, drawn) in enumerate(maps(100, 3)):
        plan = generated(kind, UNSEEN[kind][n % len(UNSEEN[kind])]).graph
        for method in decided:
            answer = matcher(method).match(drawn.s_graph, plan)
            if answer.hypotheses and (answer.hypotheses[0].probability or 0.0) >= 0.99:
                decided[method] += 1
                assert is_right(answer, drawn), (method, kind, n)
    assert decided["learned"] > 1.1 * decided["voting"]


def test_missing_and_wrong_weights_give_one_line(tmp_path: Path) -> None:
    other = Path(judge.__file__).parents[1] / "weights/paper_published.safetensors"
    files = {"none": "cannot be read", "text": "no weights of a judge", "cut": "no weights of a judge"}
    (tmp_path / "text").write_bytes(b"nothing")
    (tmp_path / "cut").write_bytes(judge.SHIPPED.read_bytes()[:-4])
    for file, wrong in {**{tmp_path / name: wrong for name, wrong in files.items()}, other: "another network",
                        tmp_path: "cannot be read"}.items():  # fmt: skip
        with pytest.raises(UserError, match=wrong) as error:
            Matcher.load(f"learned@{file}")
        assert str(file) in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(UserError, match="takes no weights"):
        Matcher.load(f"voting@{judge.SHIPPED}")


def test_the_trained_network_is_the_one_that_judges(found: Hypotheses, examples: Examples, tmp_path: Path) -> None:
    torch.manual_seed(3)
    network = JudgeNetwork()
    torch.nn.init.normal_(network.head_2.weight)
    save_judge(tmp_path / "judge.safetensors", judge_of([network]))
    placements = placements_of(found, Signs.of(found))
    inputs = (placements.tokens, placements.of, placements.features)
    with torch.no_grad():
        expected = network(*(torch.from_numpy(each) for each in inputs)).numpy()
    assert np.allclose(Judge.load(tmp_path / "judge.safetensors").logits(placements), expected, atol=1e-3)
    untrained = Judge({name: value.numpy()[None] for name, value in JudgeNetwork().state_dict().items()})
    by_evidence = np.array([h.probability for h in Matcher.load("voting").match(as_map(SMALL), SMALL).hypotheses])
    walls = PlanWalls.of(SMALL)
    assert walls is not None
    whole = ranked(search(scene_of(as_map(SMALL), walls)))
    assert np.allclose(untrained(*whole), by_evidence, atol=1e-3)


def test_training_resumes_where_it_was(examples: Examples, tmp_path: Path) -> None:
    whole, begun = JudgeTraining.begin(1), JudgeTraining.begin(1)
    losses = list(whole.train(examples, 6, 3))
    next(begun.train(examples, 6, 3))
    begun.save(tmp_path / "checkpoint.pt")
    resumed = JudgeTraining.begin(2)
    resumed.load(tmp_path / "checkpoint.pt")
    resumed.seed = 1
    assert list(resumed.train(examples, 6, 3)) == pytest.approx(losses[1:])
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name])


@pytest.mark.slow
def test_the_command_trains_on_maps_of_files_too(tmp_path: Path) -> None:
    own = tmp_path / "maps"
    own.mkdir()
    for kind in ("apartment", "corridor"):
        plan = generated(kind, UNSEEN[kind][0])
        drawn = draw(plan.graph, "drift", np.random.default_rng(0), 3)
        plan.graph.save(own / f"{kind}.a_graph.json")
        written = MapInPlan(plan.building, drawn.s_graph, f"{kind}.a_graph.json", drawn.T_a_s, drawn.floor)
        written.save(own / f"{kind}.map.json")
        assert MapInPlan.load(own / f"{kind}.map.json") == written
    words = ["--out", str(tmp_path / "run"), "--maps", str(own), "--drawn", "8", "--steps", "2", "--workers", "1"]
    assert main(words) == 0
    assert Judge.load(tmp_path / "run" / "judge.safetensors")
    (own / "corridor.map.json").write_text("{}")
    assert "no map of python -m evaluation.maps" in refused("matching.train", *words, "--seed", "1")
