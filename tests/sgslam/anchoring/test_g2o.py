"""Factor graphs of S-Graphs: what is read, what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from g2o_files import T_BIM_MAP, LoopBuilding, drawn_graph

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.slam_output.g2o import PlaneGraph, plane_of, read_g2o

SE2 = Path(__file__).parents[4] / "shared/data/slam_graphs"
DRAWN = drawn_graph()


def read(drawn: LoopBuilding, folder: Path, *more: str) -> PlaneGraph:
    """With more lines."""
    return read_g2o(replace(drawn, lines=[*drawn.lines, *more]).write(folder)[0])


def test_what_is_fixed_is_dropped_with_its_edges(tmp_path: Path) -> None:
    graph = read(DRAWN, tmp_path)
    assert set(graph.keyframes) == set(DRAWN.keyframes) and set(graph.planes) == set(DRAWN.pairs)
    assert set(graph.rooms) == {300, 301, 302} and len(graph.steps) == 5 and len(graph.seen) == 24
    assert not graph.refused  # the room edges' unset numbers have no meaning and are not read
    step = graph.steps[0]
    off = np.linalg.inv(graph.keyframes[step.first] @ step.T_first_second) @ graph.keyframes[step.second]
    np.testing.assert_allclose(off, np.eye(4), atol=1e-5)
    np.testing.assert_allclose(np.diag(step.information), [0.04, 0.04, 0.04, 1.5, 1.5, 1.5])


def test_the_s_graph_has_the_rooms_and_the_walls_between_their_corners(tmp_path: Path) -> None:
    drawn = drawn_graph(bend=0.0)
    s = read(drawn, tmp_path).scene_graph()
    assert len(s.wall_surfaces) == 12 and {r.id for r in s.rooms} == {"r300", "r301", "r302"}
    for surface in s.wall_surfaces:
        wall = drawn.plan.surface_by_id[drawn.pairs[plane_of(surface.id)]]
        centre, normal = (T_BIM_MAP @ [*surface.centroid, 0, 1])[:2], T_BIM_MAP[:2, :2] @ surface.normal
        np.testing.assert_allclose(centre, wall.centroid, atol=0.2)  # by the odometry's slips
        np.testing.assert_allclose(normal, wall.normal, atol=0.02)
        assert surface.length == pytest.approx(wall.length, abs=0.01)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("EDGE_SE3_PLANE 100 200", "EDGE_SE3_PLANE 100 999", "names 999, which is not a VERTEX_PLANE"),
        ("EDGE_SE3_PLANE 100 200", "EDGE_SE3_PLANE 200 100", "names 200, which is not a VERTEX_SE3:QUAT"),
        ("EDGE_SE3:QUAT 100 101", "EDGE_SE3:QUAT 100", "EDGE_SE3:QUAT needs 30 numbers and has 29"),
        (
            "EDGE_SE3_PLANE 100 200",
            "EDGE_SE3_PLANE 100 200 1 0 0\nUNKNOWN",
            "EDGE_SE3_PLANE needs 6 numbers and has 5",
        ),
        ("VERTEX_PLANE 200", "VERTEX_PLANE x", "'x'"),
        ("VERTEX_PLANE 201", "VERTEX_PLANE 200", "the id 200 is given twice"),
        ("VERTEX_PLANE 200 ", "VERTEX_PLANE 200 nan ", "never set"),
        ("VERTEX_PLANE 200 ", "VERTEX_PLANE 200 1e-310 ", "never set"),
        ("VERTEX_PLANE 200 ", "VERTEX_PLANE 200 3 ", "not a unit vector"),
        ("VERTEX_SE3:QUAT 100 ", "VERTEX_SE3:QUAT 100 3 ", "not a unit quaternion"),
        ("VERTEX_SE3:QUAT 100 ", "VERTEX_SE3:QUAT 100 word ", "to float: 'word'"),
    ],
)
def test_bad_lines_are_reported_in_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    number = next(k for k, line in enumerate(DRAWN.lines, 1) if line.startswith(old))
    lines = [line.replace(old, new, 1) if k == number else line for k, line in enumerate(DRAWN.lines, 1)]
    with pytest.raises(UserError, match=f"line {number}:.*{message}") as error:
        read(replace(DRAWN, lines=lines), tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "nothing in it; give a .g2o file"),
        ("\n".join([*DRAWN.lines, "FIX " + " ".join(map(str, DRAWN.keyframes))]).encode(), "no keyframe"),
        (b"\xff\xfe\x00\x81", "not text"),
        (None, "cannot be read"),
    ],
    ids=["empty", "all fixed", "binary", "missing"],
)
def test_files_without_a_graph_are_reported(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "graph.g2o"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=message):
        read_g2o(path)


def test_edges_with_numbers_that_were_never_set_are_refused(tmp_path: Path) -> None:
    graph = read(DRAWN, tmp_path, "EDGE_SE3_PLANE 100 200 1 0 0 3.3e-312 10 0 0 10 0 10")
    reason = "EDGE_SE3_PLANE of 100 and 200 holds a number that was never set (3.3e-312)"
    assert len(graph.seen) == 24 and graph.refused == (reason,)


@pytest.mark.skipif(not (SE2 / "SE2_s_graph.g2o").exists(), reason=f"{SE2}/SE2_s_graph.g2o is not there")
def test_the_published_graph_is_read_as_it_is() -> None:
    graph = read_g2o(SE2 / "SE2_s_graph.g2o")
    assert (len(graph.keyframes), len(graph.planes), len(graph.rooms), len(graph.seen)) == (20, 18, 6, 92)
    known, own = SceneGraph.load(SE2 / "SE2.json", "s_graph"), graph.scene_graph()
    assert len(own.wall_surfaces) == 20  # of the sixth room the file does not tell the walls
    for surface in own.wall_surfaces:
        np.testing.assert_allclose(surface.centroid, known.surface_by_id[surface.id].centroid, atol=0.02)
