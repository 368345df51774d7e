"""Sinkhorn's normalisation of a rectangular affinity with dummy columns, as the published matcher uses it."""

import torch
from torch import Tensor

LEAST = -600.0  # logits below the best of their column by more are as good as none; less would leave double precision


def soft_assignment(affinity: Tensor, temperature: float, iterations: int) -> Tensor:
    """(N1, N2) the part of the doubly-stochastic matrix that belongs to the nodes of both graphs.

    `affinity` (N1, N2) is divided by the temperature; the smaller side is filled up with |N1 - N2| dummies that like
    all nodes the same. `iterations` normalisations of the smaller graph's nodes (and the dummies) and of the
    larger's follow in turns; after an even number the larger graph's nodes share out exactly 1.

    The dummies never differ, so one column with their number as its weight stands for them, and only the two scales
    of the kernel's rows and columns are kept: the same numbers as those of normalising a square matrix in turns
    (Sinkhorn and Knopp 1967), in time O(N1 N2) an iteration. In double precision, which spares the logarithms.
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
