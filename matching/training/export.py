"""A trained network as files: ONNX for inference, safetensors for further training or other programs."""

import io
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import onnx
import torch
from onnxruntime import GraphOptimizationLevel, InferenceSession, SessionOptions
from safetensors.torch import save
from torch import Tensor, nn

from data.common.files import write_atomically
from data.generation.buildings import generate_plan
from matching.proposals.features import plan_features
from matching.proposals.learned import MAP, OUTPUTS, PLAN
from matching.proposals.network import Encoded, Graph, MatchingNetwork

ENOUGH = 0.93  # mean probability of the walls' best answers, at which the later cycles are left out
OPSET = 18  # of ONNX


class Inference(nn.Module):
    """Encodes a map and matches it with an encoded plan. A plan is encoded as a map, with a plan of no walls."""

    def __init__(self, network: MatchingNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Takes `MAP` and `PLAN`, returns `OUTPUTS`: the map's vectors of walls (N, width) and rooms (M, width),
        candidates (N, K) of its walls, -1 for none, and their probabilities (N, K).
        """
        node, neighbour, edge, wall, room = inputs[: len(MAP)]
        plan = dict(zip((name.removeprefix("plan_") for name in PLAN), inputs[len(MAP) :], strict=True))
        none = wall.new_zeros(1, 1)  # only a map's logits of no match are used
        s = self.network.encode(Graph(node, neighbour, edge, wall, room, floor=torch.zeros_like(room)))
        column, table = self.network(s, Encoded(no_wall=none, no_room=none, **plan), ENOUGH).walls[-1]
        return s.walls, s.rooms, column, table.softmax(dim=-1)[:, :-1]


def save_network(folder: Path, network: MatchingNetwork) -> None:
    """Writes `learned.onnx` and `learned.safetensors`, which holds the settings and the weights by their names."""
    settings = {name: str(value) for name, value in vars(network.settings).items()}
    state = {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
    write_atomically(folder / "learned.safetensors", save(state, settings))
    write_atomically(folder / "learned.onnx", to_onnx(network))


def to_onnx(network: MatchingNetwork) -> bytes:
    """The network as an ONNX model for any number of walls and rooms."""
    with torch.no_grad():
        graph = Graph.of(plan_features(generate_plan("apartment", 0).graph), network.sharpness.device)
        plan = network.encode(graph)
        inputs = (*graph[:5], plan.walls, plan.rooms, plan.wall, plan.room, plan.floor, plan.near)
        file = io.BytesIO()
        with warnings.catch_warnings():
            # Only this exporter of torch's two does it in seconds; it warns of its age, and that the number of nodes is
            # not constant.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                Inference(network).eval(),
                inputs,
                file,  # type: ignore[arg-type]
                input_names=[*MAP, *PLAN],
                output_names=list(OUTPUTS),
                dynamic_axes={name: {0: f"{name}_count"} for name in (*MAP, *PLAN, *OUTPUTS)},
                opset_version=OPSET,
                dynamo=False,
            )
    return _simplified(file.getvalue())


def _simplified(content: bytes) -> bytes:
    """The same model with constants folded: it loads in half the time."""
    with TemporaryDirectory() as folder:
        options = SessionOptions()
        options.graph_optimization_level = GraphOptimizationLevel.ORT_ENABLE_BASIC
        options.optimized_model_filepath = f"{folder}/model.onnx"
        options.log_severity_level = 3  # no warning that the file is for this machine: basic changes are for all
        InferenceSession(content, options, providers=["CPUExecutionProvider"])
        model = onnx.load(options.optimized_model_filepath)
    used = [each for each in model.opset_import if each.domain in {node.domain for node in model.graph.node}]
    del model.opset_import[:]
    model.opset_import.extend(used)
    return bytes(model.SerializeToString())
