"""Building blocks of networks in single precision, compiled, without gradients."""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled, power_of_two
from matching.network.features import Array32

_0, _HALF, _1, _2 = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_LOW, _HIGH = np.float32(-70), np.float32(88)  # e to these is a number of single precision, also times a share
_PER_LN2, _LN2, _LN2_REST = np.float32(1.44269504), np.float32(0.693359375), np.float32(-2.12194440e-4)
_ROUNDING = np.float32(12582912)  # 1.5 * 2^23: what is added to it is rounded
_E2, _E3, _E4 = np.float32(5.0000001201e-1), np.float32(1.6666665459e-1), np.float32(4.1665795894e-2)
_E5, _E6, _E7 = np.float32(8.3334519073e-3), np.float32(1.3981999507e-3), np.float32(1.9875691500e-4)
_ROOT_HALF = np.float32(np.sqrt(0.5))
_A1, _A2, _A3 = np.float32(0.0705230784), np.float32(0.0422820123), np.float32(0.0092705272)
_A4, _A5, _A6 = np.float32(0.0001520143), np.float32(0.0002765672), np.float32(0.0000430638)
_EPSILON = np.float32(1e-5)  # of torch's LayerNorm


class Linear(NamedTuple):
    """x @ weight + bias."""

    weight: Array32  # (in, out)
    bias: Array32  # (out,)


class Norm(NamedTuple):
    """Gain and bias of a layer norm, both (width,)."""

    gain: Array32
    bias: Array32


@compiled
def exp(x: np.float32) -> np.float32:
    """e^x to a few units in the last place (as in S. Moshier's Cephes); loops over it compile to vector code."""
    x = min(max(x, _LOW), _HIGH)
    n = (x * _PER_LN2 + _ROUNDING) - _ROUNDING
    r = x - n * _LN2 - n * _LN2_REST
    series = ((((_E7 * r + _E6) * r + _E5) * r + _E4) * r + _E3) * r + _E2
    return (series * r * r + r + _1) * power_of_two(n)  # type: ignore[no-any-return]


@compiled
def sigmoid(x: np.float32) -> np.float32:
    """1 / (1 + e^-x)."""
    return _1 / (_1 + exp(-x))


@compiled
def tanh(x: np.float32) -> np.float32:
    """Accurate to about 1e-7."""
    return _1 - _2 / (_1 + exp(x + x))


@compiled
def gelu(x: np.float32) -> np.float32:
    """x times the normal distribution function of x, accurate to about 1e-6 (M. Abramowitz, I. Stegun: 7.1.28)."""
    z = abs(x) * _ROOT_HALF
    root = (((((_A6 * z + _A5) * z + _A4) * z + _A3) * z + _A2) * z + _A1) * z + _1
    root *= root
    root *= root
    root *= root
    return max(x, _0) - abs(x) * _HALF / (root * root)


@compiled
def linear(x: Array32, layer: Linear) -> Array32:
    """Maps (n, in) to (n, out)."""
    found = np.dot(x, layer.weight)
    for row in range(found.shape[0]):
        for k in range(found.shape[1]):
            found[row, k] += layer.bias[k]
    return found


@compiled
def linear_gelu(x: Array32, layer: Linear) -> Array32:
    """Maps (n, in) to (n, out), followed by GELU."""
    found = np.dot(x, layer.weight)
    for row in range(found.shape[0]):
        for k in range(found.shape[1]):
            found[row, k] = gelu(found[row, k] + layer.bias[k])
    return found


@compiled
def normed(x: Array32, norm: Norm) -> Array32:
    """(n, width) layer norm of each row."""
    share = np.full(x.shape[1], _1 / np.float32(x.shape[1]), dtype=np.float32)
    mean, found, square = np.dot(x, share), np.empty_like(x), np.empty_like(x)
    for row in range(x.shape[0]):
        for k in range(x.shape[1]):
            found[row, k] = x[row, k] - mean[row]
            square[row, k] = found[row, k] * found[row, k]
    variance = np.dot(square, share)
    for row in range(x.shape[0]):
        scale = _1 / np.sqrt(variance[row] + _EPSILON)
        for k in range(x.shape[1]):
            found[row, k] = found[row, k] * scale * norm.gain[k] + norm.bias[k]
    return found


@compiled
def softmax(table: Array32) -> Array32:
    """(n, m) softmax of each row."""
    found = np.empty_like(table)
    for row in range(table.shape[0]):
        most, total = table[row].max(), np.float32(0)
        for k in range(table.shape[1]):
            found[row, k] = exp(table[row, k] - most)
        for k in range(table.shape[1]):
            total += found[row, k]
        total = _1 / total
        for k in range(table.shape[1]):
            found[row, k] *= total
    return found
