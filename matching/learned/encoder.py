"""`network.encoder` for one graph, without gradients, as compiled loops over the same weights."""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled
from matching.arrays import Index
from matching.learned.named_weights import NamedWeights
from matching.network.arithmetic import Linear, Norm, exp, linear, linear_gelu, normed, sigmoid
from matching.network.dimensions import HEADS
from matching.network.features import EDGE_SIZE, NODE_SIZE, Array32

BLOCK = 16  # nodes processed at once, so that their edges fit the processor's cache
_LOWEST, _LEAST = np.float32(-1e30), np.float32(1e-30)


class Layer(NamedTuple):
    """The weights of `network.encoder.NeighbourAttention`."""

    before: Norm
    query: Linear
    key: Array32
    edge: Array32
    attention: Array32  # (width, HEADS), zero but where a head has its own
    out: Linear
    norm: Norm
    widen: Linear
    narrow: Linear


class EncoderWeights(NamedTuple):
    """The weights of `network.encoder.Encoder` without its layers."""

    node: Linear
    node_again: Linear
    edge: Linear
    edge_again: Linear
    after: Norm


def encoder_of(w: NamedWeights, width: int) -> EncoderWeights:
    """Returns the weights outside the layers."""
    return EncoderWeights(
        w.linear("encoder.node.0", NODE_SIZE, width), w.linear("encoder.node.2", width, width),
        w.linear("encoder.edge.0", EDGE_SIZE, width), w.linear("encoder.edge.2", width, width),
        w.norm("encoder.after", width),
    )  # fmt: skip


def layers_of(w: NamedWeights, width: int, count: int) -> tuple[Layer, ...]:
    """Returns the weights of the layers, first to last."""
    return tuple(_layer_of(w, f"encoder.layers.{k}", width) for k in range(count))


def _layer_of(w: NamedWeights, name: str, width: int) -> Layer:
    attention, own = np.zeros((width, HEADS), dtype=np.float32), width // HEADS
    for k, head in enumerate(w.array(f"{name}.attention", HEADS, own)):
        attention[k * own : (k + 1) * own, k] = head
    return Layer(
        w.norm(f"{name}.before", width), w.linear(f"{name}.query", width, width),
        w.matrix(f"{name}.key", width, width), w.matrix(f"{name}.edge", width, width), attention,
        w.linear(f"{name}.out", width, width), w.norm(f"{name}.ffn.0", width),
        w.linear(f"{name}.ffn.1", width, 2 * width), w.linear(f"{name}.ffn.3", 2 * width, width),
    )  # fmt: skip


@compiled
def embedded(node: Array32, edge: Array32, w: EncoderWeights) -> tuple[Array32, Array32]:
    """Embeds nodes (V, NODE_SIZE) as (V, width) and edges (V, k, EDGE_SIZE) as (V * k, width)."""
    h = linear(linear_gelu(node, w.node), w.node_again)
    rows = edge.reshape(edge.shape[0] * edge.shape[1], edge.shape[2])
    block = BLOCK * edge.shape[1]
    found = np.empty((len(rows), w.edge_again.weight.shape[1]), dtype=np.float32)
    for first in range(0, len(rows), block):
        found[first : first + block] = linear_gelu(linear_gelu(rows[first : first + block], w.edge), w.edge_again)
    return h, found


@compiled
def attention_layer(h: Array32, edge: Array32, neighbour: Index, w: Layer) -> Array32:
    """Applies one layer to nodes (V, width), edges (V * k, width) and neighbours (V, k), -1 for none; returns (V,
    width).
    """
    nodes, k = neighbour.shape
    x = normed(h, w.before)
    query, key, messages = linear(x, w.query), np.dot(x, w.key), np.zeros_like(h)
    for first in range(0, nodes, BLOCK):
        last = min(first + BLOCK, nodes)
        seen = np.dot(edge[first * k : last * k], w.edge)
        for n in range(first, last):
            for m in range(k):
                row, other = (n - first) * k + m, max(neighbour[n, m], 0)
                for d in range(seen.shape[1]):
                    y = seen[row, d] + key[other, d] + query[n, d]
                    seen[row, d] = y * sigmoid(y)
        _aggregate(seen, np.dot(seen, w.attention), neighbour[first:last], messages[first:last])
    out, hidden = linear(messages, w.out), h.copy()
    for n in range(nodes):
        for d in range(h.shape[1]):
            hidden[n, d] += out[n, d]
    return hidden + linear(linear_gelu(normed(hidden, w.norm), w.widen), w.narrow)


@compiled
def _aggregate(seen: Array32, score: Array32, neighbour: Index, messages: Array32) -> None:
    """Adds to `messages` (n, width) those of the neighbours (n, k), weighted by attention.

    `seen` (n * k, width) holds each neighbour's message, `score` (n * k, HEADS) its attention logits, overwritten.
    """
    (n, k), heads = neighbour.shape, score.shape[1]
    wide, most = seen.shape[1] // heads, np.empty(heads, dtype=np.float32)
    total = np.full((n, heads), _LEAST)
    for node in range(n):
        for head in range(heads):
            most[head] = _LOWEST
        for m in range(k):
            for head in range(heads if neighbour[node, m] >= 0 else 0):
                most[head] = max(most[head], score[node * k + m, head])
        for m in range(k):
            for head in range(heads):
                there = neighbour[node, m] >= 0
                score[node * k + m, head] = score[node * k + m, head] - most[head] if there else _LOWEST
    flat = score.reshape(score.size)
    for place in range(len(flat)):
        flat[place] = exp(flat[place])
    for row in range(n * k):
        for head in range(heads):
            total[row // k, head] += score[row, head]
    for row in range(n * k):
        node = row // k
        for head in range(heads if neighbour[node, row - node * k] >= 0 else 0):
            share = score[row, head] / total[node, head]
            for d in range(head * wide, (head + 1) * wide):
                messages[node, d] += share * seen[row, d]
