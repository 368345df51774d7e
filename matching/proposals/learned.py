"""The trained network as a proposer: takes an S-graph and an A-graph, returns likely partners, which are then verified.

The network is an ONNX file, which `python -m matching.train` writes; PyTorch is not needed.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from matching.arrays import Index, PlanCache, Walls
from matching.engine.proposals import MOST, TopK
from matching.proposals.features import (
    EDGE_SIZE,
    NEIGHBOURS,
    NODE_SIZE,
    SUPPORTERS,
    GraphFeatures,
    map_features,
    plan_features,
)

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SHIPPED = Path(__file__).parents[1] / "weights" / "learned.onnx"
MOST_BYTES = 1 << 24  # of a file
MAP = ("node", "neighbour", "edge", "wall", "room")  # inputs: fields of `GraphFeatures`
PLAN = ("plan_walls", "plan_rooms", "plan_wall", "plan_room", "plan_floor", "plan_near")  # inputs: `network.Encoded`
OUTPUTS = ("walls", "rooms", "column", "probability")
SIZES = {"node": NODE_SIZE, "neighbour": NEIGHBOURS, "edge": EDGE_SIZE, "wall": 5, "plan_near": SUPPORTERS}  # last axes
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class _Plan:
    encoded: Arrays  # the network's inputs PLAN
    surface: Index  # (A,) the number of each wall in the graph's `wall_surfaces`


class LearnedProposer:
    """Proposes matches of wall surfaces with the network; what it computes of the last few plans is cached."""

    def __init__(self, session: "InferenceSession") -> None:
        self._session = session
        width = next(i.shape[1] for i in session.get_inputs() if i.name == "plan_walls")
        vectors, index = np.zeros((0, width), dtype=np.float32), np.zeros(0, dtype=np.int64)
        wall, near = np.zeros((0, SIZES["wall"]), dtype=np.float32), np.zeros((0, SUPPORTERS), dtype=np.int64)
        self._no_plan: Arrays = dict(zip(PLAN, (vectors, vectors, wall, index, index, near), strict=True))
        self._plan = PlanCache(self._plan_of)

    @staticmethod
    def load(path: Path | str | None = None) -> "LearnedProposer":
        """Loads a network from a file, by default the shipped one. Raises UserError if the file does not hold one."""
        if path is None and not SHIPPED.is_file():
            raise UserError("the learned matcher's weights are not installed; give a file that matching.train wrote")
        return LearnedProposer(_session(Path(path or SHIPPED)))

    def propose(self, s: SceneGraph, a: SceneGraph, known: Walls | None = None) -> TopK:
        """Returns the likely partners of each S wall surface, in the order of the graphs.

        `known` are the surfaces of S as arrays, if they are already computed.
        """
        if not s.wall_surfaces or not a.wall_surfaces:
            return TopK(np.zeros((len(s.wall_surfaces), 0), dtype=np.int64), np.zeros((len(s.wall_surfaces), 0)))
        plan, seen = self._plan(a), map_features(s, known)
        column, probability = self._session.run(["column", "probability"], {**_inputs(seen), **plan.encoded})
        at = np.argsort(-probability, axis=1, kind="stable")[:, :MOST]
        column, probability = (np.take_along_axis(x, at, axis=1) for x in (column, probability))
        partner = np.where(column >= 0, plan.surface[column], -1)
        return TopK(partner, np.where(column >= 0, probability, 0.0))

    def _plan_of(self, a: SceneGraph) -> _Plan:
        """Encodes a plan as if it were a map, of no plan."""
        seen = plan_features(a)
        walls, rooms = self._session.run(["walls", "rooms"], {**_inputs(seen), **self._no_plan})
        encoded = dict(zip(PLAN, (walls, rooms, seen.wall, seen.room, seen.floor, seen.near), strict=True))
        place = {w.id: n for n, w in enumerate(a.wall_surfaces)}
        return _Plan(encoded, np.array([place[name] for name in seen.wall_ids]))


def _inputs(seen: GraphFeatures) -> Arrays:
    return {name: getattr(seen, name) for name in MAP}


def _session(path: Path) -> "InferenceSession":
    """Opens a network, to run on one thread. Raises UserError unless the file holds one with the expected inputs."""
    from onnxruntime import ExecutionMode, InferenceSession, SessionOptions  # slow to import

    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a network's file (.onnx)") from None
    options = SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # of errors, which are raised as well, only fatal ones are printed
    wrong = UserError(f"{path}: not a network of this version; 'python -m matching.train' writes one (learned.onnx)")
    if len(content) > MOST_BYTES:
        raise wrong
    try:
        session = InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception:  # the runtime runs no code from the file, but raises many kinds of errors
        raise wrong from None
    inputs = {i.name: i.shape for i in session.get_inputs()}
    if tuple(inputs) != (*MAP, *PLAN) or tuple(o.name for o in session.get_outputs()) != OUTPUTS:
        raise wrong
    if any(inputs[name][-1] != size for name, size in SIZES.items()) or not isinstance(inputs["plan_walls"][-1], int):
        raise wrong
    return session
