"""The soundness of placed maps is fitted to runs of known truth."""

import json
from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from evaluation.calibration import fit, main, placed_maps
from evaluation.rows import Provenance, Row

MADE = Provenance(build="", commit="", command="", machine="", date="")
NAMES = ("plan_tilt_deg", "map_against_odometry", "position_sigma_m", "walls_looked_through")
Signals = list[dict[str, float]]


def drawn(count: int, middle: float, spread: float, ratio: float, seed: int, alike: bool = False) -> Signals:
    """Signals whose logarithms are Laplace distributed, all the same where they are `alike`, and crossings."""
    rng = np.random.default_rng(seed)
    logarithms = rng.laplace(middle, spread, (count, 1 if alike else len(NAMES)))
    crossed = rng.geometric(1 - ratio, count) - 1
    return [
        {**dict(zip(NAMES, np.broadcast_to(np.exp(own), len(NAMES)).tolist(), strict=True)), "planned_walls_crossed": k}
        for own, k in zip(logarithms, crossed.tolist(), strict=True)
    ]


def test_known_distributions_are_found_again() -> None:
    model = fit(drawn(6000, -4.0, 0.6, 0.02, 0), drawn(2000, -3.0, 0.9, 0.4, 1))
    for name in NAMES:
        assert model.sound[name] == pytest.approx((-4.0, 0.6), abs=0.05)
        assert model.unsound[name] == pytest.approx((-3.0, 0.9), abs=0.1)
    assert model.unsound["planned_walls_crossed"][0] == pytest.approx(0.4, abs=0.03)
    assert model.share > 0.9 and model.prior == pytest.approx(np.log(3), abs=0.3)  # independent; three to one


def test_signals_that_say_the_same_count_once() -> None:
    sound, unsound = drawn(4000, -4.0, 0.6, 1e-9, 0, True), drawn(4000, -3.0, 0.6, 1e-9, 1, True)
    assert fit(sound, unsound).share == pytest.approx(1 / len(NAMES), abs=0.03)


def test_probabilities_are_right_on_average_and_both_kinds_are_told_apart() -> None:
    model = fit(drawn(4000, -4.0, 0.6, 0.02, 0), drawn(4000, -3.0, 0.9, 0.4, 1))
    kinds = drawn(4000, -4.0, 0.6, 0.02, 2), drawn(4000, -3.0, 0.9, 0.4, 3)
    known = np.array([[model.judged(own).probability for own in kind] for kind in kinds])
    for low, high in ((0.05, 0.3), (0.3, 0.7), (0.7, 0.95)):
        inside = (known > low) & (known < high)
        assert inside[0].sum() / inside.sum() == pytest.approx(known[inside].mean(), abs=0.06)
    apart = fit(drawn(50, -6.0, 0.2, 0.01, 0), drawn(50, 0.0, 0.2, 0.8, 1))
    assert min(apart.judged(own).probability for own in drawn(200, -6.0, 0.2, 0.01, 2)) > 0.99
    assert max(apart.judged(own).probability for own in drawn(200, 0.0, 0.2, 0.8, 3)) < 0.01


def test_a_crossing_that_was_never_seen_is_not_impossible() -> None:
    clean, crossing = (
        [{**own, "planned_walls_crossed": k} for own in drawn(30, -4.0, 0.6, 0.1, 0)] for k in (0.0, 3.0)
    )
    model = fit(clean, crossing)
    assert 0 < model.sound["planned_walls_crossed"][0] < 0.1 < model.unsound["planned_walls_crossed"][0] < 1


def row(wrong: int, seed: int, trouble: str = "", placed: bool = True) -> Row:
    """Of 1000 scans so many are wrong."""
    signals = drawn(1, -4.0 if wrong < 10 else -2.0, 0.5, 0.1, seed)[0]
    record = {"placed": {"scans": 1000, "wrong": wrong, "signals": signals} if placed else None}
    return Row({"trouble": trouble, "seed": seed}, record, MADE)


def test_a_map_is_sound_if_at_most_a_hundredth_of_its_scans_is_wrong(tmp_path: Path) -> None:
    none = [row(500, 3, "foreign plan"), row(500, 4, placed=False), Row({"seed": 5}, {"status": "failed"}, MADE)]
    rows = [row(10, 1, "sliding doors"), row(11, 2), *none]
    sound, unsound = placed_maps(rows)
    assert sound == [rows[0].record["placed"]["signals"]] and unsound == [rows[1].record["placed"]["signals"]]
    (tmp_path / "rows.jsonl").write_bytes(b"".join(own.line() for own in rows))
    words = [str(tmp_path / "rows.jsonl"), "--out", str(tmp_path / "out.json")]
    (tmp_path / "out.json").write_text('{"known_map": [1, 2, 3], "prior": null}')  # what other commands fitted stays
    assert main(words) == 0
    stored = json.loads((tmp_path / "out.json").read_text())
    assert stored["known_map"] == [1, 2, 3] and stored["prior"] is not None
    assert stored["maps"] == {"sound": 1, "unsound": 1} and stored["sound"].keys() == stored["unsound"].keys()
    (tmp_path / "rows.jsonl").write_bytes(rows[0].line())
    with pytest.raises(UserError, match="1 and 0"):
        main(words)
