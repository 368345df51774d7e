"""All parts of one known map, laid anywhere: a map drawn from a plan stands for the published one."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plans import a_graph, flat

from data.common.errors import UserError
from data.geometry import se2
from data.scene_graph.motion import moved
from data.synthetic_maps.noise_models import draw
from evaluation.published.se2_subsets import Known, outcomes, parts
from matching import Matcher

pytestmark = pytest.mark.slow

PLAN = a_graph(flat(np.random.default_rng(5)), "ground")
DRAWN = draw(PLAN, "real", np.random.default_rng(2), 4)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    matches = {"rooms": [*DRAWN.rooms.items()], "wall_surfaces": [*DRAWN.wall_surfaces.items()]}
    path = tmp_path / "known.json"
    path.write_text(json.dumps({"s_graph": DRAWN.s_graph.to_dict(), "a_graph": PLAN.to_dict(), "matches": matches}))
    return path


def test_every_part_under_every_motion_is_measured_against_its_own_truth(file: Path) -> None:
    known = Known.load(file)
    found = list(outcomes(known, Matcher.load(), motions=2))
    assert len(parts(known)) == 6 + 4 + 1 and len(found) == 2 * 11
    assert not any(o.wrong for o in found)
    assert sum(o.status == "unique" for o in found) > 11
    whole = [o for o in found if o.rooms_seen == 4]
    assert all(o.rooms.right == 4 and o.walls.right >= 0.9 * o.walls.true for o in whole)
    wrong = Known(known.s_graph, known.a_graph, dict.fromkeys(known.rooms, PLAN.rooms[0].id), known.wall_surfaces)
    assert all(o.wrong for o in outcomes(wrong, Matcher.load(), motions=1) if o.status == "unique")


def test_a_moved_part_is_the_same_part() -> None:
    T = np.array([2.0, 30.0, -7.0])
    back = moved(moved(DRAWN.s_graph, T), se2.inverse(T))
    for of, there in zip(back.wall_surfaces, DRAWN.s_graph.wall_surfaces, strict=True):
        assert of.centroid == pytest.approx(there.centroid) and of.normal == pytest.approx(there.normal)


def test_the_command_prints_its_table_and_writes_the_page(file: Path, tmp_path: Path) -> None:
    page = tmp_path / "PAGE.md"
    line = [sys.executable, "-m", "evaluation.published.se2_subsets", str(file), "--motions", "1", "--page", str(page)]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    assert [text.split("|")[1].strip() for text in done.stdout.splitlines()[2:]] == ["2", "3", "4", "all"]
    assert "| all | 11 |" in page.read_text() and "`python -m evaluation.published.se2_subsets" in page.read_text()
    (tmp_path / "bad.json").write_text('{"s_graph": 1}')
    with pytest.raises(UserError, match=r"bad\.json"):
        Known.load(tmp_path / "bad.json")
