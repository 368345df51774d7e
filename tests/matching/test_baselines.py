"""PCA-GM and SuperGlue on our features: what their parts promise, their answers, their files."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from plans import a_graph, flat, merged, moved

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.learned.torch_weights import load_network, save_network
from matching.network.parts import sinkhorn
from matching.network.registry import KINDS, network_of, settings_of
from matching.published.baselines import BaselineMatcher, hungarian, mutual_best
from matching.training.data import batch_of
from matching.training.loss import accuracies, loss, run, surprise

RELATIVES = [kind for kind in KINDS if kind != "learned"]
PLAN = a_graph(flat(np.random.default_rng(1), 12, 9))
OTHER = a_graph(flat(np.random.default_rng(2), 9, 7))
DRAWN = draw(PLAN, "real", np.random.default_rng(0), 3)


def untrained(kind: str):
    torch.manual_seed(0)
    return network_of(settings_of(kind)).eval().requires_grad_(False)


def test_sinkhorn_shares_rows_and_columns_among_each_other_and_nothing():
    table = sinkhorn(3 * torch.randn(4, 6, generator=torch.Generator().manual_seed(0)), torch.tensor(0.5)).exp()
    assert torch.allclose(table.sum(dim=1), torch.ones(4), atol=1e-5)
    assert (table[:, :-1].sum(dim=0) < 1.001).all()
    sure = sinkhorn(torch.tensor([[20.0, 0.0], [0.0, -20.0]]), torch.tensor(0.0)).exp()
    assert sure[0].argmax() == 0 and sure[1].argmax() == 2
    assert sinkhorn(torch.zeros(2, 0), torch.tensor(0.0)).shape == (2, 1)


@pytest.mark.parametrize("kind", RELATIVES)
def test_pairs_of_a_batch_do_not_disturb_each_other_and_the_frame_does_not_matter(kind: str):
    network = untrained(kind)
    other = draw(OTHER, "mis_segmented", np.random.default_rng(3), 2)
    turned = dataclasses.replace(DRAWN, s_graph=moved(DRAWN.s_graph, 2.0, 40.0, -7.0))
    with torch.inference_mode():
        alone, _ = run(network, batch_of([(PLAN, [DRAWN])]), torch.device("cpu"))
        both, truth = run(network, batch_of([(OTHER, [other]), (PLAN, [DRAWN, turned])]), torch.device("cpu"))
    n, m = len(alone.dense), alone.dense.shape[1] - 1
    for part in (both.dense[-2 * n : -n], both.dense[-n:]):
        assert torch.allclose(part[:, :m], alone.dense[:, :m], atol=2e-3)
        assert torch.allclose(part[:, -1], alone.dense[:, -1], atol=2e-3)
    assert np.isfinite(surprise(both, truth)) and accuracies(both, truth)["within"][0] == 1


@pytest.mark.slow
@pytest.mark.parametrize("kind", RELATIVES)
def test_it_learns_and_answers_with_its_own_assignment(kind: str, tmp_path: Path):
    torch.manual_seed(0)
    torch.set_num_threads(1)
    drawn = draw(OTHER, "real", np.random.default_rng(0), 2)
    network, batch = network_of(settings_of(kind)), batch_of([(OTHER, [drawn])])
    optimizer = torch.optim.AdamW(network.parameters(), 2e-3)
    losses = []
    for _ in range(14):
        value = loss(*run(network, batch, torch.device("cpu")))
        losses.append(value.item())
        optimizer.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 2.0)
        optimizer.step()
    assert losses[-1] < 0.9 * losses[0]
    save_network(tmp_path / "n.pt", network)
    result = Matcher.load(f"{kind}@{tmp_path / 'n.pt'}").match(drawn.s_graph, OTHER)
    assert result.status == "unique" and result.wall_surfaces
    assert all(0 <= c <= 1 for _, _, c in (*result.rooms, *result.wall_surfaces))
    assert len({a for _, a, _ in result.wall_surfaces}) == len(result.wall_surfaces)
    for name in KINDS:
        if name != kind:
            with pytest.raises(UserError, match="version"):
                load_network(tmp_path / "n.pt", name)


@pytest.mark.parametrize("kind", RELATIVES)
def test_maps_without_rooms_and_single_storeys_are_answered(kind: str):
    matcher = BaselineMatcher(untrained(kind))
    bare = SceneGraph("map", (), tuple(dataclasses.replace(w, room=None) for w in DRAWN.s_graph.wall_surfaces))
    assert matcher.match(bare, PLAN).rooms == ()
    two = merged(*(a_graph(flat(np.random.default_rng(k), 9, 7), f"f{k}", f"{k}") for k in (0, 1)))
    chosen = matcher.match(DRAWN.s_graph, two, floor="f1")
    assert all(a.startswith("1") for _, a, _ in chosen.wall_surfaces)


def test_assignments():
    table = np.log(np.array([[0.6, 0.3, 0.1], [0.55, 0.4, 0.05], [0.1, 0.1, 0.8]]))
    assert hungarian(table).tolist() == [0, 1, -1]
    assert mutual_best(table).tolist() == [0, -1, -1]
    assert mutual_best(np.zeros((2, 1))).tolist() == [-1, -1]
    assert hungarian(np.zeros((0, 4))).tolist() == []


@pytest.mark.parametrize("kind", RELATIVES)
def test_shipped_weights_find_most_of_a_map_of_a_plan_never_seen(kind: str):
    matcher, right, expected = Matcher.load(kind), 0, 0
    for seed in range(3):
        drawn = draw(PLAN, "real", np.random.default_rng(seed), 6)
        result = matcher.match(drawn.s_graph, PLAN)
        right += sum(drawn.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces)
        expected += len(drawn.wall_surfaces)
    assert right > 0.5 * expected
