"""Sinkhorn's normalisation of a rectangular affinity with dummy columns, as the published matcher uses it."""

import torch
from torch import Tensor

LEAST = -600.0  # logits below the best of their column by more are as good as none; less would leave double precision


def soft_assignment(affinity: Tensor, temperature: float, iterations: int) -> Tensor:
    """Returns (N1, N2) the soft assignment of an affinity (N1, N2) without its dummies.

    The affinity is divided by the temperature, and the smaller side is filled with |N1 - N2| dummies of equal affinity.
    `iterations` normalisations alternate between the smaller graph's nodes (with the dummies) and the larger's; after
    an even number the nodes of the larger graph sum to exactly 1.

    The dummies stay equal, so one column weighted by their number replaces them, and only the scales of the kernel's
    rows and columns are stored. The result equals that of normalising a square matrix (Sinkhorn and Knopp 1967) in O(N1
    N2) per iteration. Double precision makes logarithms unnecessary.
    """
    if affinity.shape[0] < affinity.shape[1]:
        return soft_assignment(affinity.T, temperature, iterations).T
    logits = affinity.double() / temperature
    dummies = logits.shape[0] - logits.shape[1]
    kernel = (logits - logits.detach().amax(dim=0)).clamp(min=LEAST).exp()
    kernel = torch.cat((kernel, kernel.new_ones(len(kernel), 1)), dim=1) if dummies else kernel
    many = kernel.new_ones(kernel.shape[1])
    if dummies:
        many = torch.cat((many[:-1], many.new_full((1,), float(dummies))))
    row, column = kernel.new_ones(kernel.shape[0]), kernel.new_ones(kernel.shape[1])
    for k in range(iterations):
        if k % 2 == 0:
            column = 1 / (row @ kernel)
        else:
            row = 1 / (kernel @ (many * column))
    soft = row[:, None] * kernel * column
    return soft[:, : affinity.shape[1]].to(affinity.dtype)
