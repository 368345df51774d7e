"""The published tables: pairs whose truth holds, which methods are asked, and the tables."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from known_maps import write_known_map
from plans import a_graph, flat
from study_rows import rows_of

from data import UserError
from data.geometry import se2
from evaluation.matching_benchmark.pairs import Prepared
from evaluation.matching_benchmark.records import MatchRecord, Tally
from evaluation.published.pairs import PublishedPair, published_pairs
from evaluation.published.study import Choice, PublishedCase, cases, measure
from evaluation.published.tables import claims, plots, tables
from matching.published.network import REPOSITORY, PaperNetwork
from matching.published.weights import save_paper_network

NOTHING = Choice(msd=None, generated=0, known_map=None, slam_graphs=None, methods=("voting",))


def choice(**changed: Any) -> Choice:
    return NOTHING.model_copy(update=changed)


@pytest.fixture
def apartments(tmp_path: Path) -> Path:
    folder = tmp_path / "msd"
    folder.mkdir()
    rooms = [
        {"name": f"r{n}", "polygon": {"type": "Polygon", "coordinates": [[*r, r[0]]]}}
        for n, r in enumerate(flat(np.random.default_rng(0), 9, 7))
    ]
    (folder / "p.json").write_text(json.dumps({"name": "p", "unit": "m", "rooms": rooms}))
    return folder


@pytest.fixture
def known(tmp_path: Path) -> Path:
    return write_known_map(tmp_path / "known.json", a_graph(flat(np.random.default_rng(5), 12, 9), "ground"), 3)


def distance_of_partners(prepared: Prepared) -> float:
    """The largest distance between the centroids of true partners by the true motion, metres."""
    a, s = prepared.plan.graph, prepared.drawn.s_graph
    of_a = {i: node.centroid for nodes in (a.room_by_id, a.surface_by_id) for i, node in nodes.items()}
    truth = {**prepared.truth.rooms, **prepared.truth.wall_surfaces}
    points = {i: np.array(node.centroid) for nodes in (s.room_by_id, s.surface_by_id) for i, node in nodes.items()}
    placed = {i: se2.apply(np.array(prepared.truth.T_a_s), p) for i, p in points.items()}
    return max(float(np.hypot(*(placed[i] - of_a[j]))) for i, j in truth.items())


def test_a_moved_start_takes_its_truth_along(apartments: Path) -> None:
    pairs = [c.pair for c in cases(choice(msd=str(apartments), pairs=1)) if isinstance(c.pair, PublishedPair)]
    assert [pair.start_m for pair in pairs] == [0, 1, 5, 20]
    at_home = pairs[0].prepare()
    for pair in pairs[1:]:
        there = pair.prepare()
        assert distance_of_partners(there) < 0.02
        shift = there.drawn.s_graph.centroid() - at_home.drawn.s_graph.centroid()
        assert 0 < np.abs(shift).max() <= pair.start_m
        assert there.drawn.s_graph.centroid() == pytest.approx(np.array(there.truth.s_centroid))
        assert there.drawn.T_a_s == there.truth.T_a_s == there.drawn.T_a_s_by_room[next(iter(there.drawn.rooms))]
        assert pair.prepare().drawn == there.drawn


def test_parts_of_a_known_map_are_there_as_they_lie_and_moved_anywhere(known: Path) -> None:
    parts = [c.pair for c in cases(choice(known_map=str(known)))]
    assert len(parts) == 2 * 4 and [p.rooms for p in parts[:4]] == [2, 2, 2, None]
    yaws = {regime: [p.prepare().truth.T_a_s[0] for p in parts if p.regime == regime] for regime in MOVED}
    assert len({round(yaw, 3) for yaw in yaws["known_map_moved"]}) == 4
    assert np.ptp(yaws["known_map"]) < 0.1


MOVED = ("known_map", "known_map_moved")


def test_generated_apartments_lie_near_the_origin() -> None:
    middles = np.array([pair.prepare().plan.graph.centroid() for pair in published_pairs("apartment", 6, 0)])
    assert np.abs(middles).max() <= 15 and np.ptp(middles, axis=0).min() > 1


def test_the_slow_search_is_asked_for_the_tables_alone(apartments: Path, known: Path) -> None:
    options = choice(
        msd=str(apartments), pairs=2, generated=2, known_map=str(known), slow_pairs=1, methods=("combinatorial",)
    )
    asked = [case.pair for case in cases(options)]
    assert [p.plans for p in asked if isinstance(p, PublishedPair)] == [str(apartments), "apartment"]
    assert all(p.regime == "known_map" for p in asked[2:]) and len(asked) == 2 + 4


def test_what_is_missing_is_named_and_mistakes_are_told(tmp_path: Path) -> None:
    gone = {name: str(tmp_path / name) for name in ("msd", "known_map", "slam_graphs")}
    listed = cases(choice(**gone))
    assert set().union(*(case.files() for case in listed)) == set(gone.values())
    assert all(not Path(file).exists() for case in listed for file in case.files())
    with pytest.raises(UserError, match="no matching method"):
        cases(choice(methods=("no",)))
    with pytest.raises(UserError, match=r"w\.pt"):
        cases(choice(networks={"untrained": str(tmp_path / "w.pt")}))


def row(method: str, tally: tuple[tuple[int, ...], tuple[int, ...]], start_m: float | None = 0.0, **more: Any) -> Any:
    """A case and its record: right, answered and true of rooms and of walls."""
    network = more.pop("network", None)
    seen = {"rooms": more.pop("rooms", None), "index": more.pop("index", 0), "seed": 0}
    pair: dict[str, Any] = {"plans": "a/msd", "plan": "p", **seen}
    pair |= {"regime": "real"} if start_m is None else {"regime": "paper", "start_m": start_m}
    case = PublishedCase.model_validate({"pair": pair, "method": method, "limit_s": 60, "network": network})
    room_tally, wall_tally = (Tally(right=right, answered=answered, true=true) for right, answered, true in tally)
    values = {
        "status": "unique", "reason": "", "wrong": False, "twin": False, "rival": None, "seconds": 0.25,
        "building": "b", "size": 5, "s_rooms": 4, "s_walls": 16, **more,
    }  # fmt: skip
    return case, MatchRecord(**values, room_tally=room_tally, wall_tally=wall_tally)


def test_the_tables_hold_published_numbers_and_ours(tmp_path: Path) -> None:
    nothing = ((0, 0, 4), (0, 0, 16))
    rows = rows_of([
        row("combinatorial", nothing, status="late", seconds=60.0),
        row("combinatorial", ((4, 4, 4), (16, 16, 16)), index=1),
        row("combinatorial", nothing, status="none", seconds=60.01, index=2),
        row("paper@published", ((4, 4, 4), (8, 16, 16))),
        row("paper@published", ((1, 4, 4), (1, 16, 16)), 20.0),
        row("paper@published", ((1, 2, 4), (8, 12, 16)), None, rooms=2),
        row("paper@published", ((4, 4, 4), (16, 16, 16)), None),
        row("paper@x.pt", ((2, 4, 4), (8, 16, 16)), network="without ring edges"),
    ])  # fmt: skip
    found = tables(rows)
    assert set(found) == {"perturbed", "unknown_start", "contributions"}
    perturbed = found["perturbed"]
    assert perturbed["pairs of"].tolist()[::2] == ["its MSD test set", "synthetic apartments", "MSD apartments"]
    assert perturbed.F1.tolist()[:4] == ["0.95", "0.85", "0.683", "0.966"]
    slow, paper = perturbed.iloc[4], perturbed.iloc[5]
    assert slow.pairs == "3" and slow.completed == "33 %" and slow["F1 of the completed"] == "1.000"
    assert slow.F1.startswith("0.333 [") and slow["time (s)"] == "40.087"
    assert paper.F1.startswith("0.600 [") and paper["F1 of the completed"] == ""
    (start,) = found["unknown_start"].to_dict("records")
    assert start == {
        "method": "the paper's matcher, `paper@published`", "±0 m": "0.600", "±20 m": "0.100",
        "`real`, 2 rooms": f"{2 * 9 / 34:.3f}", "`real`, all rooms": "1.000",
    }  # fmt: skip
    (part,) = found["contributions"].to_dict("records")
    assert part["method"] == "without ring edges" and part["F1"].startswith("0.500")
    assert claims(rows)[0].value.startswith("0.600 [") and claims(rows)[0].cases == "1 pairs"
    plots(rows, tmp_path)
    assert (tmp_path / "published-collapse.svg").stat().st_size > 1000


@pytest.mark.slow
def test_all_that_is_listed_is_measured(apartments: Path, known: Path, tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = str(tmp_path / "w.pt")
    save_paper_network(tmp_path / "w.pt", PaperNetwork(REPOSITORY))
    options = choice(msd=str(apartments), pairs=1, generated=1, known_map=str(known), networks={"untrained": network})
    listed = cases(options)
    counts = {m: sum(case.method == m for case in listed) for m in {case.method for case in listed}}
    assert counts == {"voting": 4 + 3 + 1 + 8, f"paper@{network}": 1 + 1}  # the plan has fewer than 6 rooms
    assert all(PublishedCase.model_validate_json(case.key) == case for case in listed)
    assert all(network in case.files() for case in listed if case.network == "untrained")
    rows = rows_of((case, measure(case, tmp_path)) for case in listed)
    assert not (rows.status == "failed").any()
    found = tables(rows)
    assert found["slam_built"].pairs.tolist()[2:] == ["4", "4"]
    assert found["contributions"]["method"].tolist() == ["untrained"] * 2
