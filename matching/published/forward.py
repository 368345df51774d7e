"""The forward pass of the published matcher alone, for timing: tensors in, soft assignment out."""

from collections.abc import Callable

import torch
from torch import Tensor

from data.scene_graph import SceneGraph
from matching.published.graph import paper_graph
from matching.published.network import Nodes
from matching.published.weights import load_paper_network


def paper_forward(s: SceneGraph, a: SceneGraph) -> Callable[[], Tensor]:
    """Returns a function that computes the (A nodes, S nodes) soft assignment; the graphs are converted to tensors
    once, here.

    Raises UserError if the weights are missing.
    """
    network = load_paper_network("published")
    settings = network.settings
    ours, theirs = (Nodes.of([paper_graph(g, settings.edges, settings.without)]) for g in (a, s))

    def forward() -> Tensor:
        with torch.inference_mode():
            return network(ours, theirs)[0]

    return forward
