"""The published matcher's forward pass by itself, to be timed: tensors in, soft assignment out."""

from collections.abc import Callable

import torch
from torch import Tensor

from data.scene_graph import SceneGraph
from matching.published.graph import paper_graph
from matching.published.network import Nodes
from matching.published.weights import load_paper_network


def paper_forward(s: SceneGraph, a: SceneGraph) -> Callable[[], Tensor]:
    """What computes the (A nodes, S nodes) assignment, each time anew; the graphs' tensors are made here, once.

    Raises UserError where the weights are missing.
    """
    network = load_paper_network("published")
    settings = network.settings
    ours, theirs = (Nodes.of([paper_graph(g, settings.edges, settings.without)]) for g in (a, s))

    def forward() -> Tensor:
        with torch.inference_mode():
            return network(ours, theirs)[0]

    return forward
