"""The study of time: a drive is played at its pace and ends as a run does, and the tables have all that was timed."""

import sys
from pathlib import Path

import pandas as pd
import pytest

from data.common.errors import UserError
from evaluation.studies.timing import PIPELINE, RUN, Choice, Timed, _seconds, cases, claims, measure, tables


def test_each_drive_is_measured_in_three_ways() -> None:
    found = cases(Choice(buildings=("demo", "office"), seeds=(0, 1)))
    assert [case.what for case in found] == ["programs"] * 4 + ["live"] * 4 + ["long"] * 4
    assert len({case.key for case in found}) == len({case.group for case in found}) == 12
    assert (found[0].seconds, found[4].seconds, found[8].seconds) == (120.0, 300.0, 1800.0)


def test_a_program_is_timed_from_its_start_to_its_end() -> None:
    assert (
        0.3 < _seconds([sys.executable, "-c", "import os, time; assert os.environ['A']; time.sleep(0.3)"], A="b") < 20
    )
    with pytest.raises(UserError, match=r"failed: .*ZeroDivisionError"):
        _seconds([sys.executable, "-c", "1 / 0"])


@pytest.mark.long
@pytest.mark.slow
def test_a_drive_is_played_at_its_pace_and_ends_as_a_run(tmp_path: Path) -> None:
    found = measure(Timed(building="demo", seconds=6.0, carrier="handheld", what="live"), tmp_path)
    assert found["scans"] == 60 and found["dropped"] == 0 and found["from_run_m"] < 1e-9
    assert 0 < found["p50_ms"] <= found["p99_ms"] <= found["p100_ms"]
    assert [part["scan"] for part in found["parts"]] == [*range(6, 61, 6)]
    assert sum(6 / part["pace"] for part in found["parts"]) > 5.5  # s: ten scans a second, as the sensor measures
    assert min(part[name] for part in found["parts"] for name in ("memory_mb", "map_mb")) > 50


def test_tables_have_all_that_was_timed() -> None:
    def turn(s: float) -> list[dict[str, object]]:
        times = {RUN: s, PIPELINE: 2.0}
        return [{"program": name, "s": own, "times": own / 2.0, "pace": 100 / own} for name, own in times.items()]

    parts = [{"scan": 5, "pace": 20.0, "memory_mb": 400.0, "map_mb": 300.0}]
    fed = {"building": "demo", "scans": 5, "p50_ms": 9.0, "p99_ms": 30.0, "p100_ms": 50.0, "late": 0, "dropped": 0}
    live = {**fed, "what": "live", "rmse_m": 0.01, "from_run_m": 0.0, "parts": parts}
    long = {**fed, "what": "long", "rmse_m": None, "parts": [{**parts[0], "map_mb": 0.0}]}
    programs = {"what": "programs", "building": "demo", "scans": 100, "programs": turn(20.0) + turn(40.0)}
    made = tables(pd.DataFrame([programs, live, long]))
    assert made["programs"].iloc[0].tolist() == [RUN, "2", "4 (2–5)", "15.0 (10.0–20.0)"]
    assert made["drives"]["99 % (ms)"].tolist() == ["30", "30"] and made["drives"]["RMSE (m)"].tolist() == ["0.010", ""]
    assert made["parts"]["memory (MB)"].tolist() == ["400", "400"]
    assert [claim.value for claim in claims(pd.DataFrame([programs, live]))] == ["15.0 (10.0–20.0)", "30"]
    assert "programs" not in tables(pd.DataFrame([live]))
