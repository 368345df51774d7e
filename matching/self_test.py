"""Small jobs that check the installation: a matcher's first result, a network file for readers."""

from pathlib import Path

from data.common.compiling import once_on_two_cores
from data.scene_graph import Door, Room, SceneGraph, WallSurface
from matching.matcher import Matcher


def make_ready(matcher: Matcher, method: str) -> None:
    """Runs a matcher on three small rooms, so that its compiled loops are loaded or compiled before a robot needs them.

    `method` is the name by which it was loaded.
    """
    if method.partition("@")[0] == "learned":  # the one method of which there is much to compile
        once_on_two_cores("learned", propose, search)
    plan = three_rooms()
    matcher.match(plan, plan)


def propose() -> None:
    """The first half of what `learned` compiles."""
    from matching.proposals.learned import LearnedProposer

    LearnedProposer.load().propose(three_rooms(), three_rooms())


def search() -> None:
    """Compiles the other half."""
    Matcher.load("voting").match(three_rooms(), three_rooms())


def three_rooms() -> SceneGraph:
    """Returns a small plan."""
    sizes = ((0.0, 0.0, 4.0, 3.0), (4.2, 0.0, 9.0, 3.5), (0.0, 3.2, 4.0, 8.0))
    rooms, walls, doors = [], [], (Door("d0", ("r0", "r1"), (4.1, 1.5)), Door("d1", ("r0", "r2"), (2.0, 3.1)))
    for n, (x0, y0, x1, y1) in enumerate(sizes):
        x, y, room = (x0 + x1) / 2, (y0 + y1) / 2, f"r{n}"
        rooms.append(Room(room, (x, y), polygon=((x0, y0), (x1, y0), (x1, y1), (x0, y1))))
        sides = (((x0, y), (1.0, 0.0)), ((x1, y), (-1.0, 0.0)), ((x, y0), (0.0, 1.0)), ((x, y1), (0.0, -1.0)))
        for k, (middle, normal) in enumerate(sides):
            walls.append(WallSurface(f"{room}w{k}", room, middle, normal, y1 - y0 if normal[0] else x1 - x0))
    return SceneGraph("bim", tuple(rooms), tuple(walls), doors)


def write_small_network(path: Path) -> None:
    """Writes a small untrained network (.onnx), always the same."""
    import torch

    from matching.proposals.network import MatchingNetwork, Settings
    from matching.training.export import to_onnx

    torch.manual_seed(0)
    path.write_bytes(to_onnx(MatchingNetwork(Settings(width=8, layers=1, candidates=4, more=2, state=4))))
