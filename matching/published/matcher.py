"""The published matcher: every node of the S-graph gets a partner, without verification; and its network's files."""

import json
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
from scipy.optimize import linear_sum_assignment

from data.common.errors import UserError
from data.common.files import write_atomically
from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.published.network import PRESETS, PaperNetwork, PaperSettings, paper_graph
from matching.result import Hypothesis, MatchResult, Pair, Start, near_start

SHIPPED = Path(__file__).parents[1] / "weights"
REASON = "the published matcher answers every time; nothing was checked"


def save_paper_network(path: Path, network: PaperNetwork) -> None:
    """Writes weights, in single precision, and settings as a safetensors file, atomically."""
    metadata = {"settings": json.dumps(asdict(network.settings))}
    write_atomically(path, safetensors.torch.save(dict(network.state_dict()), metadata))


def load_paper_network(weights: Path | str) -> PaperNetwork:
    """Reads a network from a file, or the shipped one of a preset (`published`, `repository`), ready for inference.

    Raises UserError if the file is missing or does not hold such a network.
    """
    path = SHIPPED / f"paper_{weights}.safetensors" if weights in PRESETS else Path(weights)
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            settings = PaperSettings(**json.loads(file.metadata()["settings"]))
        network = PaperNetwork(settings)
        safetensors.torch.load_model(network, path)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror or error}); give a network's file") from None
    except (safetensors.SafetensorError, KeyError, TypeError, ValueError, RuntimeError):
        raise UserError(f"{path}: not a network that 'python -m matching.published.train' writes") from None
    return network.eval().requires_grad_(False)


@dataclass(frozen=True)
class PaperMatcher:
    """Matches by the network's soft assignment and the Hungarian algorithm."""

    network: PaperNetwork

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`. The status is `unique` wherever there is a pair, since the method cannot reject a match.

        Confidences are the entries of the soft assignment. The method allows a room to be matched to a wall surface;
        such matches are dropped. `T_a_s` is not part of the method; it brings the centroids of partners closest to each
        other. `start` only drops an answer that is far from it.
        """
        began = time.perf_counter()
        a = a if floor is None else a.on_floor(floor)
        for what, graph in (("S-graph", s), ("A-graph", a)):
            if not graph.wall_surfaces:
                return MatchResult("none", f"the {what} has no wall surface")
        rooms, walls = self._pairs(s, a)
        if not rooms and not walls:
            reason = "no partner is of its own type"
            return MatchResult("none", reason, seconds=time.perf_counter() - began)
        in_s = [s.room_by_id[i].centroid for i, _, _ in rooms] + [s.surface_by_id[i].centroid for i, _, _ in walls]
        in_a = [a.room_by_id[j].centroid for _, j, _ in rooms] + [a.surface_by_id[j].centroid for _, j, _ in walls]
        T_a_s = closest_motion(np.array(in_s), np.array(in_a))
        if start is not None and not near_start(start, np.array(T_a_s)):
            reason = "the answer is not near the start that was given"
            return MatchResult("none", reason, seconds=time.perf_counter() - began)
        floors = [a.room_by_id[j].floor for _, j, _ in rooms]
        for wall in (a.surface_by_id[j] for _, j, _ in walls):
            floors.append(wall.floor if wall.room is None else a.room_by_id[wall.room].floor)
        most = Counter(floors).most_common(1)[0][0]
        sole = Hypothesis(0.0, T_a_s, most, tuple((i, j) for i, j, _ in rooms))
        return MatchResult("unique", REASON, rooms, walls, T_a_s, most, (sole,), time.perf_counter() - began)

    def _pairs(self, s: SceneGraph, a: SceneGraph) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
        """The pairs of rooms and of wall surfaces."""
        ours, theirs = paper_graph(a), paper_graph(s)
        with torch.inference_mode():
            soft = self.network([ours], [theirs])[0].double().numpy()
        found: tuple[list[Pair], list[Pair]] = ([], [])
        for j, i in zip(*linear_sum_assignment(soft, maximize=True), strict=True):
            is_wall = bool(i >= theirs.rooms)
            if is_wall == bool(j >= ours.rooms):
                found[is_wall].append((theirs.ids[i], ours.ids[j], float(min(max(soft[j, i], 0.0), 1.0))))
        return tuple(found[0]), tuple(found[1])


def closest_motion(p: Array, q: Array) -> tuple[float, float, float]:
    """Returns the motion (yaw, x, y) that brings the points p (N, 2) closest to q (N, 2)."""
    middle_p, middle_q = p.mean(axis=0), q.mean(axis=0)
    yaw = float(np.angle(np.vdot((p - middle_p) @ [1, 1j], (q - middle_q) @ [1, 1j])))
    x, y = (middle_q - se2.rotate(yaw, middle_p)).tolist()
    return yaw, x, y
