"""The learned proposals: they know neither frame nor order, the compiled network is torch's, and files are whole."""

import dataclasses
import io
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from plans import a_graph, flat, moved

from data import Floor, SceneGraph, UserError
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import Matcher
from matching.learned import LearnedProposer
from matching.learned.network import CompiledNetwork
from matching.learned.torch_weights import load_network, save_network
from matching.network.consensus import _support, wall_rows
from matching.network.dimensions import Settings
from matching.network.encoder import GraphTensors
from matching.network.features import PairRows, map_features, plan_features
from matching.network.network import MatchingNetwork
from matching.network.relations import wall_neighbours
from matching.network.support_loops import combinations

# Of an untrained network's candidates, which are all alike, the seventh and the eighth are told apart.
SMALL = Settings(width=32, layers=2, candidates=7, cycles=2, rounds=2)
PLAN = a_graph(flat(np.random.default_rng(3), 10, 8))
Arrays = dict[str, np.ndarray[Any, Any]]


@pytest.fixture(scope="module")
def drawn() -> DrawnGraph:
    return draw(PLAN, "drift", np.random.default_rng(1), 3)


def untrained(settings: Settings = SMALL) -> MatchingNetwork:
    torch.manual_seed(0)
    return MatchingNetwork(settings).eval().requires_grad_(False)


def table(proposer: LearnedProposer, s: SceneGraph, a: SceneGraph) -> dict[tuple[str, str], float]:
    """All proposals by ids."""
    found = proposer.propose(s, a)
    pairs = {}
    for of, in_s, in_a in ((found.walls, s.wall_surfaces, a.wall_surfaces), (found.rooms, s.rooms, a.rooms)):
        for k, (partner, score) in enumerate(zip(of.partner, of.score, strict=True)):
            pairs |= {(in_s[k].id, in_a[j].id): float(p) for j, p in zip(partner, score, strict=True) if j >= 0}
    return pairs


def shuffled(g: SceneGraph) -> SceneGraph:
    rng = np.random.default_rng(0)
    walls, rooms = rng.permutation(len(g.wall_surfaces)), rng.permutation(len(g.rooms))
    surfaces = tuple(g.wall_surfaces[k] for k in walls)
    return dataclasses.replace(g, wall_surfaces=surfaces, rooms=tuple(g.rooms[k] for k in rooms))


def test_proposals_know_neither_where_the_graphs_lie_nor_the_order_of_nodes(drawn: DrawnGraph) -> None:
    proposer, s = LearnedProposer(CompiledNetwork.of(untrained())), drawn.s_graph
    expected = table(proposer, s, PLAN)
    for T in ((0.0, 400000.0, 5600000.0), (2.3, -3.0, 8.0), (np.pi / 2, 0.0, 0.0)):
        for graphs in ((moved(s, *T), PLAN), (s, moved(PLAN, *T)), (shuffled(s), shuffled(PLAN))):
            found = table(proposer, *graphs)
            for pair, p in expected.items():  # the order of the least likely is chance
                assert found.get(pair, 0.0) == pytest.approx(p, abs=2e-3) or p < 0.05, pair


@pytest.mark.parametrize(("noise", "rooms", "storeys"), [("drift", 3, 1), ("mis_segmented", 2, 2), ("real", 1, 1)])
def test_the_compiled_network_says_what_torchs_says(noise: str, rooms: int, storeys: int) -> None:
    s, a = draw(PLAN, noise, np.random.default_rng(7), rooms).s_graph, PLAN
    if storeys == 2:
        bare = tuple(dataclasses.replace(w, id=f"l{w.id}", room=None, floor="lower") for w in PLAN.wall_surfaces)
        upper = a_graph(flat(np.random.default_rng(3), 10, 8), "upper")
        floors = (Floor("upper"), Floor("lower"))
        a = dataclasses.replace(upper, wall_surfaces=(*upper.wall_surfaces, *bare), floors=floors)
    network = untrained(Settings(candidates=5))
    f, g = map_features(s), plan_features(a)
    pair = PairRows(*((0, len(x)) for x in (f.walls, g.walls, f.rooms, g.rooms)))
    with torch.inference_mode():
        output = network(network.encode(GraphTensors.of(f)), network.encode(GraphTensors.of(g)), [pair])
    compiled = CompiledNetwork.of(network)
    found = compiled.match(compiled.encode(f), compiled.encode(g), enough=1.0)
    column, odds = output.walls[-1]
    np.testing.assert_array_equal(found.column, column.numpy())
    assert (found.column[:, 5:] >= 0).any(), "candidates come from later cycles too"
    np.testing.assert_allclose(found.walls, odds.softmax(-1)[:, :-1].numpy(), atol=1e-5)
    np.testing.assert_allclose(found.rooms, output.rooms[-1].softmax(-1)[:, :-1].numpy(), atol=1e-5)


def test_a_gpu_looks_at_the_combinations_that_the_compiled_loop_looks_at(drawn: DrawnGraph) -> None:
    s, a = GraphTensors.of(map_features(drawn.s_graph)), GraphTensors.of(plan_features(PLAN))
    shape, last = (len(s.wall_node), 9), len(a.wall_node)
    row = torch.randint(-1, last, shape, generator=torch.Generator().manual_seed(0))
    compiled = combinations(wall_rows(s), wall_rows(a), row.numpy())
    of_gpu = _support(s, a, row, wall_neighbours(s), 0, len(row))
    (p, q, f), (u, v, g) = ([torch.as_tensor(x) for x in found] for found in (compiled, of_gpu))
    one, other = (pair * row.numel() + partner for pair, partner in ((p, q), (u, v)))
    assert len(one) > 100 and torch.equal(one.sort().values, other.sort().values)
    torch.testing.assert_close(f[one.argsort()], g[other.argsort()], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("suffix", [".pt", ".npz"])
def test_a_network_is_read_as_it_was_written(tmp_path: Path, drawn: DrawnGraph, suffix: str) -> None:
    network, path = untrained(), tmp_path / f"n{suffix}"
    save_network(path, network)
    again = load_network(path)
    assert again.settings == SMALL and not again.training
    for one, other in zip(network.state_dict().values(), again.state_dict().values(), strict=True):
        assert other.dtype == torch.float32 and torch.allclose(one, other, rtol=1e-3, atol=1e-6)
    expected = table(LearnedProposer(CompiledNetwork.of(again)), drawn.s_graph, PLAN)
    assert table(LearnedProposer.load(path), drawn.s_graph, PLAN) == expected


class Opens:
    """Pickled, it writes a file when it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (str(self._path), "w")


def changed(change: Callable[[Arrays], object]) -> Callable[[bytes], bytes]:
    def written(whole: bytes) -> bytes:
        arrays, file = dict(np.load(io.BytesIO(whole))), io.BytesIO()
        change(arrays)
        np.savez(file, allow_pickle=True, **arrays)  # type: ignore[arg-type]
        return file.getvalue()

    return written


def unpacked_large(whole: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tag.npy", whole[:100] + bytes(1 << 26))
    return file.getvalue()


WEIGHT = "weight/encoder.node.0.weight"
FOREIGN: dict[str, Callable[[bytes], bytes]] = {
    "text": lambda whole: b"not a network",
    "cut": lambda whole: whole[: len(whole) // 2],
    "a bit": lambda whole: whole[: (n := len(whole) // 2)] + bytes([whole[n] ^ 1]) + whole[n + 1 :],
    "large": unpacked_large,
    "another version": changed(lambda a: a.update(tag=np.array("sgslam learned 999"))),
    "another shape": changed(lambda a: a.update({WEIGHT: a[WEIGHT].T})),
    "infinite": changed(lambda a: a.update({WEIGHT: a[WEIGHT] * np.float16(np.inf)})),
}


@pytest.mark.parametrize("what", FOREIGN)
def test_what_is_not_one_whole_network_is_refused(tmp_path: Path, what: str) -> None:
    save_network(tmp_path / "n.npz", untrained())
    (tmp_path / "n.npz").write_bytes(FOREIGN[what]((tmp_path / "n.npz").read_bytes()))
    with pytest.raises(UserError, match=r"n\.npz: ") as error:
        Matcher.load(f"learned@{tmp_path / 'n.npz'}")
    assert "\n" not in str(error.value)


def test_nothing_in_a_file_is_run_and_other_mistakes_are_named(tmp_path: Path) -> None:
    (tmp_path / "n.npz").write_bytes(pickle.dumps(Opens(tmp_path / "ran")))
    with pytest.raises(UserError, match=r"n\.npz"):
        Matcher.load(f"learned@{tmp_path / 'n.npz'}")
    objects = np.empty(1, dtype=object)
    objects[0] = Opens(tmp_path / "ran")
    np.savez(tmp_path / "n.npz", allow_pickle=True, tag=objects)
    with pytest.raises(UserError, match=r"n\.npz"):
        Matcher.load(f"learned@{tmp_path / 'n.npz'}")
    assert not (tmp_path / "ran").exists()
    save_network(tmp_path / "n.pt", untrained())
    value = torch.load(tmp_path / "n.pt", weights_only=True)
    torch.save({**value, "state": dict(list(value["state"].items())[1:])}, tmp_path / "short.pt")
    torch.save({"weights": 1}, tmp_path / "other.pt")
    (tmp_path / "cut.pt").write_bytes((tmp_path / "n.pt").read_bytes()[:500])
    for name in ("short.pt", "other.pt", "cut.pt", "missing.pt", "missing.npz"):
        with pytest.raises(UserError, match=name):
            Matcher.load("learned", weights=tmp_path / name)
    with pytest.raises(UserError, match="takes no weights"):
        Matcher.load("voting", weights=tmp_path / "n.pt")
