"""`network.consensus` for one pair of graphs, as compiled loops: rounds of support between candidates, and rooms."""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled, compiled_within
from matching.arrays import Index
from matching.learned.candidates import Choice, agreement, expanded, log_softmax
from matching.learned.named_weights import NamedWeights
from matching.network.arithmetic import Linear, Norm, linear, linear_gelu, normed, sigmoid, softmax, tanh
from matching.network.dimensions import (
    COMPARED_SIZE,
    COMPATIBLE_WIDTHS,
    LEAST_ODDS,
    NOTHING,
    PAIR_SIZE,
    REASONS,
    ROOM_WIDTH,
    SHARE_SIZE,
)
from matching.network.features import Array32
from matching.network.support_loops import WallRows, combinations

BLOCK = 512  # combinations processed at once, to fit the processor's cache
_0, _1, _2, _4, _5, _8, _10 = (np.float32(x) for x in (0, 1, 2, 4, 5, 8, 10))
_SHORT, _LONG = np.float32(0.35), np.float32(6)  # metres: a wall's weight is the root of its length
_NOTHING, _ODDS, _LEAST_LOGIT = np.float32(NOTHING), np.float32(LEAST_ODDS), np.float32(-30)
_TINY, _SMALL, _LITTLE = np.float32(1e-4), np.float32(1e-3), np.float32(1e-2)


class ConsensusWeights(NamedTuple):
    """The weights of `network.consensus.Consensus` and of the network's room step."""

    compatible: Linear
    compatible_again: Linear
    compatible_last: Linear
    begin: Linear
    message: Linear
    step: Linear
    step_again: Linear
    after: Norm
    score: Linear
    room: Linear
    room_again: Linear


def consensus_of(w: NamedWeights, width: int) -> ConsensusWeights:
    """Returns the weights of a network with states of this width."""
    first, second = COMPATIBLE_WIDTHS
    return ConsensusWeights(
        w.linear("consensus.compatible.0", COMPARED_SIZE, first), w.linear("consensus.compatible.2", first, second),
        w.linear("consensus.compatible.4", second, REASONS),
        w.linear("consensus.begin", PAIR_SIZE, width), w.linear("consensus.message", width, REASONS),
        w.linear("consensus.step.0", width + 2 * REASONS + PAIR_SIZE, 2 * width),
        w.linear("consensus.step.2", 2 * width, width), w.norm("consensus.after", width),
        w.linear("consensus.score", width, 1),
        w.linear("room_step.0", SHARE_SIZE, ROOM_WIDTH), w.linear("room_step.2", ROOM_WIDTH, 1),
    )  # fmt: skip


class Combinations(NamedTuple):
    """E combinations, as in `network.consensus.Support`, and the weight of each, (E, heads)."""

    pair: Index
    other: Index
    weight: Array32


@compiled
def run_consensus(
    s: WallRows, a: WallRows, dense: Array32, choice: Choice, likely: Array32, rooms: Array32,
    counts: tuple[int, int, int], enough: float, w: ConsensusWeights,
) -> tuple[Index, Array32, Array32]:  # fmt: skip
    """Runs cycles of consensus, starting from candidates with probabilities `likely` (N, K) and log odds of rooms.

    `counts` are the numbers of cycles, of rounds in each, and of candidates that each later cycle adds. Returns the
    final candidates (N, K), their probabilities, and those of rooms (M, A rooms + 1).
    """
    (cycles, rounds, more), first = counts, rooms
    for cycle in range(cycles):
        if cycle > 0:
            choice, likely = expanded(s, a, dense, choice, likely, more)
        likely, rooms, sure = consensus(s, a, choice, likely, first, rooms, rounds, w)
        if enough < 1 and sure >= enough:
            break
    return choice.column, likely, softmax(rooms)


@compiled_within
def consensus(
    s: WallRows, a: WallRows, c: Choice, likely: Array32, first: Array32, rooms: Array32, rounds: int,
    w: ConsensusWeights,
) -> tuple[Array32, Array32, float]:  # fmt: skip
    """Runs rounds of consensus among given candidates; `first` is the first estimate of the rooms.

    Returns the probabilities (N, K), the log odds of rooms (M, A rooms + 1), and the mean probability of the walls'
    best candidates.
    """
    reasons, size, sure = support(s, a, c.column, w), np.empty(len(s.half), dtype=np.float32), 0.0
    for i in range(len(size)):
        size[i] = np.sqrt(min(max(_2 * s.half[i], _SHORT), _LONG))
    whole = agreement(s, a, c, likely, size)
    feature = features(s, a, c, likely, whole, rooms)
    state = linear(feature, w.begin)
    for k in range(rounds):
        if k > 0:
            feature = features(s, a, c, likely, whole, rooms)
        state, table = consensus_round(state, feature, likely, c, reasons, w)
        answer = softmax(table)
        likely = np.ascontiguousarray(answer[:, :-1])
        rooms = updated_rooms(s, a, c, likely, size, first, w)
        sure = 0.0
        for i in range(len(answer)):
            sure += answer[i].max() / len(answer)
    return likely, rooms, sure


@compiled_within
def support(s: WallRows, a: WallRows, column: Index, w: ConsensusWeights) -> Combinations:
    """Returns all combinations of candidates that are roughly alike."""
    pair, other, feature = combinations(s, a, column)
    weight = np.empty((len(pair), w.compatible_last.weight.shape[1]), dtype=np.float32)
    for first in range(0, len(pair), BLOCK):
        seen = linear_gelu(linear_gelu(feature[first : first + BLOCK], w.compatible), w.compatible_again)
        odds = linear(seen, w.compatible_last)
        for e in range(len(odds)):
            for k in range(odds.shape[1]):
                weight[first + e, k] = sigmoid(odds[e, k] - _1)
    return Combinations(pair, other, weight)


@compiled
def features(s: WallRows, a: WallRows, c: Choice, likely: Array32, whole: Array32, rooms: Array32) -> Array32:
    """(N K, PAIR_SIZE) features of each candidate: its own, those of its competitors, and the agreement of the
    `whole` map.
    """
    n, k = likely.shape
    found, taken = np.empty((n * k, PAIR_SIZE), dtype=np.float32), np.zeros(len(a.half) + 1, dtype=np.float32)
    for i in range(n):
        for t in range(k):
            taken[c.column[i, t] + 1] += likely[i, t]
    room_odds = softmax(rooms)
    for i in range(n):
        for t in range(k):
            row, p = found[i * k + t], max(c.column[i, t], 0)
            with_room = s.room[i] >= 0 and c.column[i, t] >= 0 and a.room[p] >= 0
            longer = s.half[i] - a.half[p]
            row[0], row[1] = max(c.logit[i, t], _LEAST_LOGIT) / _10, likely[i, t]
            row[2] = likely[i, t] / (taken[c.column[i, t] + 1] + _SMALL)
            row[3], row[4] = room_odds[s.room[i], a.room[p]] if with_room else _0, with_room
            row[5], row[6] = max(longer, _0), max(-longer, _0)
            row[7:] = whole[i, t]
    return found


@compiled_within
def consensus_round(
    state: Array32, feature: Array32, likely: Array32, c: Choice, support: Combinations, w: ConsensusWeights
) -> tuple[Array32, Array32]:
    """Returns the states (N K, width) after one round, and (N, K + 1) log odds of the candidates and of no match."""
    rows, width = state.shape
    heads = support.weight.shape[1]
    message, flat = linear(state, w.message), likely.reshape(rows)
    inputs = np.zeros((rows, width + 2 * heads + feature.shape[1]), dtype=np.float32)
    inputs[:, :width], inputs[:, width + 2 * heads :] = state, feature
    for row in range(rows):
        for k in range(heads):
            message[row, k] = flat[row] * tanh(message[row, k])
    for e in range(len(support.pair)):
        received, other = inputs[support.pair[e], width : width + 2 * heads], support.other[e]
        for k in range(heads):
            received[k] += flat[other] * support.weight[e, k]
            received[heads + k] += message[other, k] * support.weight[e, k]
    state = normed(state + linear(linear_gelu(inputs, w.step), w.step_again), w.after)
    scored = linear(state, w.score)
    n, k = likely.shape
    table = np.empty((n, k + 1), dtype=np.float32)
    for i in range(n):
        for t in range(k):
            table[i, t] = c.logit[i, t] + _5 * scored[i * k + t, 0] if c.column[i, t] >= 0 else _NOTHING
        table[i, k] = c.dustbin[i]
    return state, table


@compiled_within
def updated_rooms(
    s: WallRows, a: WallRows, c: Choice, likely: Array32, size: Array32, rooms: Array32, w: ConsensusWeights
) -> Array32:
    """(M, A rooms + 1) log odds of rooms: the first estimate, updated by the share of an S room's walls in each A room.

    `size` (N,) are the weights of the S walls.
    """
    m, plan = rooms.shape[0], rooms.shape[1] - 1
    by_size, count = np.zeros((m, plan), dtype=np.float32), np.zeros((m, plan), dtype=np.float32)
    own, found = np.zeros(m, dtype=np.float32), rooms.copy()
    if m * plan == 0:
        return found
    for i in range(len(s.room)):
        r = s.room[i]
        if r < 0:
            continue
        own[r] += size[i]
        for t in range(likely.shape[1]):
            q = a.room[c.column[i, t]] if c.column[i, t] >= 0 else -1
            if q >= 0:
                by_size[r, q] += likely[i, t] * size[i]
                count[r, q] += likely[i, t]
    share, feature = np.empty_like(by_size), np.empty((m * plan, SHARE_SIZE), dtype=np.float32)
    for r in range(m):
        share[r] = by_size[r] / (own[r] + _SMALL)
    claimed = np.full(plan, _LITTLE)
    for r in range(m):
        claimed += share[r]
    for r in range(m):
        guess = log_softmax(rooms[r])
        for q in range(plan):
            row, odds = feature[r * plan + q], max(guess[q], _ODDS) / _5
            row[0], row[1] = share[r, q], np.sqrt(share[r, q] + _TINY)
            row[2], row[3] = min(count[r, q], _8) / _4, share[r, q] / claimed[q]
            row[4], row[5] = odds, np.exp(odds)
    update = linear(linear_gelu(feature, w.room), w.room_again)
    found[:, :plan] += update.reshape(m, plan)
    return found
