"""Small work: whether torch works here, a matcher's first answer, and a network's file to try readers on."""

from pathlib import Path

from data.scene_graph import Door, Room, SceneGraph, WallSurface
from matching.matcher import Matcher


def work() -> None:
    """Fails where torch does not work here."""
    import torch  # slow to import

    assert float((torch.eye(3) @ torch.ones(3)).sum()) == 3


def make_ready(matcher: Matcher) -> None:
    """Has a matcher answer on three small rooms: its compiled loops are loaded then, or compiled, and not when a robot
    waits for its first answer."""
    sizes = ((0.0, 0.0, 4.0, 3.0), (4.2, 0.0, 9.0, 3.5), (0.0, 3.2, 4.0, 8.0))
    rooms, walls, doors = [], [], (Door("d0", ("r0", "r1"), (4.1, 1.5)), Door("d1", ("r0", "r2"), (2.0, 3.1)))
    for n, (x0, y0, x1, y1) in enumerate(sizes):
        x, y, room = (x0 + x1) / 2, (y0 + y1) / 2, f"r{n}"
        rooms.append(Room(room, (x, y), polygon=((x0, y0), (x1, y0), (x1, y1), (x0, y1))))
        sides = (((x0, y), (1.0, 0.0)), ((x1, y), (-1.0, 0.0)), ((x, y0), (0.0, 1.0)), ((x, y1), (0.0, -1.0)))
        for k, (middle, normal) in enumerate(sides):
            walls.append(WallSurface(f"{room}w{k}", room, middle, normal, y1 - y0 if normal[0] else x1 - x0))
    plan = SceneGraph("bim", tuple(rooms), tuple(walls), doors)
    matcher.match(plan, plan)


def write_small_network(path: Path) -> None:
    """A network with more form than weights, always the same; untrained."""
    import torch

    from matching.networks import network_of, settings_of
    from matching.weights_file import save_network

    torch.manual_seed(0)
    save_network(path, network_of(settings_of("learned", {"width": 8, "layers": 1, "state": 4})))
