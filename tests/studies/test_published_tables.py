"""The published tables: pairs whose truth holds, rows that are not made twice, the page."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from plans import a_graph, flat

from data import UserError
from data.geometry import se2
from data.plans.sources import Plan
from data.synthetic_maps.noise_models import draw
from evaluation.matching_benchmark.pairs import Candidate, DrawnPair, Pair, Prepared
from evaluation.matching_benchmark.rows import Row, Tally, read_rows
from evaluation.published.page import f1_of, joint, page_of
from evaluation.published.pairs import SE2_ANYWHERE, generated_candidates, known_map_pairs, start_regime, with_starts
from evaluation.published.tables import main
from matching.published.network import REPOSITORY, PaperNetwork
from matching.published.weights import save_paper_network

PLAN = a_graph(flat(np.random.default_rng(5), 12, 9), "ground")


def distance_of_partners(prepared: Prepared) -> float:
    """The largest distance between the centroids of true partners by the true motion, metres."""
    of_a = {x.id: x.centroid for x in (*prepared.a_graph.rooms, *prepared.a_graph.wall_surfaces)}
    s = prepared.drawn.s_graph
    truth = {**prepared.truth.rooms, **prepared.truth.wall_surfaces}
    points = {x.id: np.array(x.centroid) for x in (*s.rooms, *s.wall_surfaces)}
    laid = {i: se2.apply(np.array(prepared.truth.T_a_s), p) for i, p in points.items()}
    return max(float(np.hypot(*(laid[i] - of_a[j]))) for i, j in truth.items())


def test_a_moved_start_takes_its_truth_along():
    pair = DrawnPair(Candidate("p", Plan("n", "b", PLAN)), Candidate("p", Plan("n", "b", PLAN)), "paper", None, 0, 0)
    found = with_starts([pair])
    assert [p.regime for p in found] == ["paper", "paper+1m", "paper+5m", "paper+20m"]
    at_home = found[0].prepare()
    for other, reach in zip(found[1:], (1, 5, 20), strict=True):
        there = other.prepare()
        assert distance_of_partners(there) < 0.02
        shift = there.drawn.s_graph.centroid() - at_home.drawn.s_graph.centroid()
        assert 0 < np.abs(shift).max() <= reach
        assert there.drawn.s_graph.centroid() == pytest.approx(np.array(there.truth.s_centroid))
        assert there.drawn.T_a_s == there.truth.T_a_s == there.drawn.T_a_s_by_room[next(iter(there.drawn.rooms))]
        assert other.prepare().drawn == there.drawn


@pytest.fixture
def known(tmp_path: Path) -> Path:
    drawn = draw(PLAN, "real", np.random.default_rng(2), 3)
    matches = {"rooms": [*drawn.rooms.items()], "wall_surfaces": [*drawn.wall_surfaces.items()]}
    path = tmp_path / "known.json"
    path.write_text(json.dumps({"s_graph": drawn.s_graph.to_dict(), "a_graph": PLAN.to_dict(), "matches": matches}))
    return path


def test_parts_of_a_known_map_are_there_as_they_lie_and_laid_anywhere(known: Path):
    found = known_map_pairs(known)
    assert len(found) == 2 * 4 and [p.rooms for p in found[:2]] == [2, 2] and found[-1].rooms is None

    def yaw(pair: Pair) -> float:
        return pair.prepare().truth.T_a_s[0]

    anywhere = [p for p in found if p.regime == SE2_ANYWHERE]
    assert len({round(yaw(p), 3) for p in anywhere}) == 4
    assert np.ptp([yaw(p) for p in found if p not in anywhere]) < 0.1


def test_generated_apartments_lie_near_the_origin():
    middles = np.array([c.plan.graph.centroid() for c in generated_candidates(6)])
    assert np.abs(middles).max() <= 15 and np.ptp(middles, axis=0).min() > 1


def row(method: str, regime: str, rooms: tuple[int, ...], walls: tuple[int, ...], **more: object) -> Row:
    values = {
        "plans": "msd-edges", "plan": "p", "building": "b", "source": "msd-edges/p", "rooms": None, "index": 0,
        "seed": 0, "size": 5, "s_rooms": 4, "s_walls": 16, "status": "unique", "reason": "", "wrong": False,
        "twin": False, "rival": None, "seconds": 0.25, "room_tally": Tally(*rooms), "wall_tally": Tally(*walls), **more,
    }  # fmt: skip
    return Row(method, regime, **values)  # type: ignore[arg-type]


def test_rooms_and_walls_are_counted_together():
    one = row("voting", "paper", (1, 2, 4), (8, 12, 16))
    assert joint(one).wall_tally == Tally(9, 14, 20)
    assert f1_of([one]) == pytest.approx(2 * 9 / 34)


def test_the_page_holds_published_numbers_and_ours():
    rows = [row("paper@published", "paper", (4, 4, 4), (8, 16, 16))]
    rows += [row("paper@published", start_regime(20), (1, 4, 4), (1, 16, 16))]
    rows += [row("combinatorial", "paper", (0, 0, 4), (0, 0, 16), status="late", seconds=60.0)]
    rows += [row("combinatorial", "paper", (4, 4, 4), (16, 16, 16), index=1)]
    rows += [row("combinatorial", "paper", (0, 0, 4), (0, 0, 16), status="none", seconds=60.01, index=2)]
    rows += [row("paper@x.pt", "paper", (2, 4, 4), (8, 16, 16))]
    text = page_of(rows, {"paper@x.pt": "without ring edges"}, Path("a/collapse.svg"))
    assert "0.99 | 0.92 | 0.95" in text and "| 0.966 |" in text and "0.600 [" in text and "docs/collapse.svg" in text
    late = next(line for line in text.splitlines() if line.startswith("| MSD apartments | iS-Graphs"))
    assert "| 3 |" in late and "| 33 % | 1.000 |" in late and "0.333 [" in late and "40.087" in late
    assert "| MSD apartments | without ring edges | 1 | 0.500" in text


@pytest.mark.slow
def test_the_command_goes_on_and_writes_all(known: Path, tmp_path: Path):
    torch.manual_seed(0)
    save_paper_network(tmp_path / "w.pt", PaperNetwork(REPOSITORY))
    page, figure = tmp_path / "page.md", tmp_path / "f.svg"
    folder = tmp_path / "plans"
    folder.mkdir()
    rooms = [
        {"name": f"r{n}", "polygon": {"type": "Polygon", "coordinates": [[*r, r[0]]]}}
        for n, r in enumerate(flat(np.random.default_rng(0), 9, 7))
    ]
    (folder / "p.json").write_text(json.dumps({"name": "p", "unit": "m", "rooms": rooms}))
    given = ["--out", str(tmp_path / "out"), "--msd", str(folder), "--pairs", "1", "--se2", str(known)]
    given += ["--generated", "1", "--methods", "voting", "--ablation", f"untrained={tmp_path / 'w.pt'}"]
    main([*given, "--page", str(page), "--figure", str(figure)])
    rows = read_rows(tmp_path / "out" / "rows.jsonl")
    counts = {m: sum(r.method == m for r in rows) for m in {r.method for r in rows}}
    assert counts == {"voting": 4 + 3 + 1 + 8, f"paper@{tmp_path / 'w.pt'}": 1 + 1}  # the plan has fewer than 6 rooms
    assert not any(r.status == "failed" for r in rows)
    before = (tmp_path / "out" / "rows.jsonl").read_bytes()
    main(given)
    assert (tmp_path / "out" / "rows.jsonl").read_bytes() == before
    assert "| untrained |" in page.read_text() and "`voting`" in page.read_text() and figure.stat().st_size > 1000


@pytest.mark.slow
def test_mistakes_are_told(tmp_path: Path):
    out = ["--out", str(tmp_path)]
    for wrong, about in ((["--ablation", "x"], "NAME=FILE"), (["--pairs", "0"], "--pairs"), ([], "nothing to match")):
        with pytest.raises(UserError, match=about):
            main([*out, "--methods", "voting", *wrong])
    with pytest.raises(UserError, match="no rows"):
        main([*out, "--report-only"])
    command = [sys.executable, "-m", "evaluation.published.tables", *out, "--methods", "no"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "no matching method" in done.stderr and done.stderr.count("\n") == 1
