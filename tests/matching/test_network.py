"""The learned proposals: they know neither frame nor order, ONNX Runtime computes what torch does, files."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper
from plans import a_graph, flat, merged, moved
from safetensors import safe_open
from safetensors.torch import load_file

from data import SceneGraph, UserError
from data.synthetic_maps.noise_models import draw
from matching import Matcher
from matching.proposals.features import map_features, plan_features
from matching.proposals.learned import LearnedProposer
from matching.proposals.network import Graph, MatchingNetwork, Settings
from matching.training.export import ENOUGH, save_network

PLAN = a_graph(flat(np.random.default_rng(3), 10, 8))
MAP = draw(PLAN, "drift", np.random.default_rng(1), 3).s_graph
ONE_WALL = dataclasses.replace(MAP, rooms=(), wall_surfaces=(dataclasses.replace(MAP.wall_surfaces[0], room=None),))


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def network() -> MatchingNetwork:
    """Its candidates of later cycles matter, and its certainty is on both sides of where cycles end."""
    torch.manual_seed(2)
    network = MatchingNetwork(Settings(candidates=5)).eval().requires_grad_(False)
    network.sharpness[0] = 30.0
    return network


@pytest.fixture(scope="module")
def file(network: MatchingNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("network")
    save_network(folder, network)
    return folder / "learned.onnx"


def table(proposer: LearnedProposer, s: SceneGraph, a: SceneGraph) -> dict[tuple[str, str], float]:
    """All proposals by ids."""
    found = proposer.propose(s, a)
    assert found.partner.shape == found.score.shape and len(found.partner) == len(s.wall_surfaces)
    return {
        (s.wall_surfaces[i].id, a.wall_surfaces[found.partner[i, k]].id): float(found.score[i, k])
        for i, k in np.argwhere(found.partner >= 0)
    }


def roomless(g: SceneGraph) -> SceneGraph:
    return SceneGraph(g.frame, (), tuple(dataclasses.replace(w, room=None) for w in g.wall_surfaces))


def shuffled(g: SceneGraph) -> SceneGraph:
    rng = np.random.default_rng(0)
    walls, rooms = rng.permutation(len(g.wall_surfaces)), rng.permutation(len(g.rooms))
    surfaces = tuple(g.wall_surfaces[k] for k in walls)
    return dataclasses.replace(g, wall_surfaces=surfaces, rooms=tuple(g.rooms[k] for k in rooms))


def test_proposals_know_neither_where_the_graphs_lie_nor_the_order_of_nodes() -> None:
    proposer = LearnedProposer.load()
    expected = table(proposer, MAP, PLAN)
    assert max(expected.values()) > 0.5
    for T in ((0.0, 400000.0, 5600000.0), (2.3, -3.0, 8.0), (np.pi / 2, 0.0, 0.0)):
        for graphs in ((moved(MAP, *T), PLAN), (MAP, moved(PLAN, *T)), (shuffled(MAP), shuffled(PLAN))):
            found = table(proposer, *graphs)
            for pair, p in expected.items():  # the order of the least likely is chance
                assert found.get(pair, 0.0) == pytest.approx(p, abs=2e-3) or p < 0.05, pair


GRAPHS: dict[str, tuple[SceneGraph, SceneGraph]] = {
    "drift": (MAP, PLAN),
    "storeys": (
        draw(PLAN, "mis_segmented", np.random.default_rng(7), 2).s_graph,
        merged(PLAN, a_graph(flat(np.random.default_rng(4)), "b", "b")),
    ),
    "a map without rooms": (roomless(MAP), PLAN),
    "a plan without rooms": (MAP, roomless(PLAN)),
    "one wall": (ONE_WALL, PLAN),
    "a plan of one wall": (MAP, ONE_WALL),
    "fewer planned walls than candidates": (MAP, SceneGraph("bim", PLAN.rooms[:1], PLAN.wall_surfaces[:3])),
}


@pytest.mark.parametrize("of", GRAPHS)
def test_the_exported_network_computes_what_torchs_does(of: str, network: MatchingNetwork, file: Path) -> None:
    s, a = GRAPHS[of]
    seen, plan = map_features(s), plan_features(a)
    with torch.inference_mode():
        output = network(network.encode(Graph.of(seen)), network.encode(Graph.of(plan)), ENOUGH)
    column, probability = output.walls[-1][0].numpy(), output.walls[-1][1].softmax(dim=-1).numpy()
    found, rows = table(LearnedProposer.load(file), s, a), np.argwhere(column >= 0)
    expected = {(seen.wall_ids[i], plan.wall_ids[column[i, k]]): probability[i, k] for i, k in rows}
    assert len(found) > 0 and all(p == pytest.approx(expected[pair], abs=2e-5) for pair, p in found.items())
    assert all(pair in found or p < 0.1 for pair, p in expected.items())


def test_cycles_end_where_the_walls_are_certain(network: MatchingNetwork) -> None:
    def run(s: SceneGraph, enough: float) -> tuple[torch.Tensor, bool]:
        encoded = (network.encode(Graph.of(f)) for f in (map_features(s), plan_features(PLAN)))
        column, _ = network(*encoded, enough).walls[-1]
        return column, bool((column[:, 5:] >= 0).any())

    assert run(MAP, 1.0)[1] and not run(MAP, 0.0)[1], "a second cycle adds candidates, unless the first was enough"


def test_the_weights_are_beside_the_model(network: MatchingNetwork, file: Path) -> None:
    weights = file.with_suffix(".safetensors")
    state = load_file(weights)
    assert all(torch.equal(value, state[name]) for name, value in network.state_dict().items())
    with safe_open(weights, "pt") as held:
        assert Settings(**{k: int(v) for k, v in held.metadata().items()}) == network.settings


def other_model(whole: bytes) -> bytes:
    """A whole ONNX model, which is another network's."""
    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", 3]) for name in "xy")
    graph = helper.make_graph([helper.make_node("Relu", ["x"], ["y"])], "other", [x], [y])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


FOREIGN: dict[str, Callable[[bytes], bytes]] = {
    "text": lambda whole: b"not a network",
    "nothing": lambda whole: b"",
    "cut": lambda whole: whole[: len(whole) // 2],
    "another model": other_model,
    "large": lambda whole: whole + bytes(1 << 24),
    "an archive of earlier versions": lambda whole: b"PK\x03\x04" + whole[:1000],
}


@pytest.mark.parametrize("what", FOREIGN)
def test_what_is_not_a_network_is_refused_in_one_line(tmp_path: Path, file: Path, what: str) -> None:
    path = tmp_path / ("learned.npz" if "archive" in what else "n.onnx")
    path.write_bytes(FOREIGN[what](file.read_bytes()))
    with pytest.raises(UserError, match=r"matching\.train") as error:
        Matcher.load(f"learned@{path}")
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_missing_file_and_weights_for_a_method_without_them_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"missing\.onnx"):
        Matcher.load(f"learned@{tmp_path / 'missing.onnx'}")
    with pytest.raises(UserError, match="takes no weights"):
        Matcher.load(f"voting@{tmp_path / 'missing.onnx'}")
