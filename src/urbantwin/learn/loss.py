"""Losses: focal loss for centres, absolute error for boxes, cross-entropy for points.

Focal loss of Law and Deng 2018, "CornerNet", equation 1, as CenterPoint uses it. The loss of a
class is divided by the square root of its mean number of objects in a sample. Divided by the
number itself, all classes would weigh the same, and the few objects of rare classes would dominate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from urbantwin.learn.heads import ClassHead
from urbantwin.learn.targets import ClassTarget, PointTarget

__all__ = [
    "BatchTarget",
    "detection_loss",
    "point_arrays",
    "point_loss",
    "target_arrays",
    "targets_in",
]

#: Exponents of the focal loss: for well-classified cells, and for cells near a centre.
_EASY, _NEAR = 2.0, 4.0
#: Lower bound of the mean number of objects in a sample.
_RAREST = 0.2


@dataclass(frozen=True, eq=False)
class BatchTarget:
    """`ClassTarget` of all samples of a batch as tensors, with consecutive cell indices.

    ``counts`` is the mask of cells that contribute to the loss.
    """

    heat: Tensor
    counts: Tensor
    cell: Tensor
    weight: Tensor
    box: Tensor


def target_arrays(samples: Sequence[Sequence[ClassTarget]]) -> dict[str, NDArray[Any]]:
    """Return the targets of a batch by the names that `targets_in` reads.

    Args:
        samples: targets of the classes, for each sample.
    """
    found: dict[str, NDArray[Any]] = {}
    for number, parts in enumerate(zip(*samples, strict=True)):
        cells = parts[0].heat.size
        found |= {
            f"{number}.heat": np.stack([one.heat for one in parts]),
            f"{number}.counts": np.stack([one.counts > 0 for one in parts]),
            f"{number}.cell": np.concatenate([one.cell + k * cells for k, one in enumerate(parts)]),
            f"{number}.weight": np.concatenate([one.weight for one in parts]),
            f"{number}.box": np.concatenate([one.box for one in parts]),
        }
    return found


def targets_in(batch: Mapping[str, Tensor], classes: int) -> list[BatchTarget]:
    """Return the targets of each class in a batch."""
    names = [one.name for one in fields(BatchTarget)]
    return [
        BatchTarget(*(batch[f"{number}.{name}"] for name in names)) for number in range(classes)
    ]


def detection_loss(
    said: Sequence[Tensor],
    wanted: Sequence[BatchTarget],
    heads: Sequence[ClassHead],
    usual: Sequence[float],
) -> Tensor:
    """Return the loss of each class (classes, 2): of centres and of boxes.

    Args:
        said: outputs of the network: (samples, `heads.OUTPUTS`, rows, columns) for each class.
        wanted: target of each class.
        heads: heads of the classes.
        usual: mean number of objects of each class in a sample.
    """
    rows = []
    for told, target, head, many in zip(said, wanted, heads, usual, strict=True):
        per = 1 / (math.sqrt(max(many, _RAREST)) * len(told))
        maps = told.float()
        logit = maps[:, 0]
        likely = torch.sigmoid(logit)
        hit = target.heat >= 1
        focal = torch.where(
            hit,
            -((1 - likely) ** _EASY) * functional.logsigmoid(logit),
            -(likely**_EASY) * (1 - target.heat) ** _NEAR * functional.logsigmoid(-logit),
        )
        centres = (focal * target.counts).sum() * per
        flat = maps[:, 1:].permute(0, 2, 3, 1).reshape(-1, maps.shape[1] - 1)
        regressed = flat.index_select(0, target.cell)
        off = torch.cat(
            [
                (regressed[:, :8] - target.box[:, :8]).abs(),
                functional.binary_cross_entropy_with_logits(
                    regressed[:, 8:], target.box[:, 8:], reduction="none"
                ),
            ],
            dim=1,
        )
        weights = off.new_tensor(head.box_weights)
        boxes = ((off * weights).sum(dim=1) * target.weight).sum() * per
        rows.append(torch.stack([centres, boxes]))
    return torch.stack(rows)


def point_arrays(samples: Sequence[PointTarget], cells: int) -> dict[str, NDArray[Any]]:
    """Return the point targets of a batch by name: features, cells and classes.

    Args:
        samples: point target of each sample.
        cells: number of cells of a grid.
    """
    return {
        "told": np.concatenate([one.told for one in samples]),
        "at": np.concatenate([one.cell + k * cells for k, one in enumerate(samples)]),
        "wanted": np.concatenate([one.wanted for one in samples]),
    }


def point_loss(said: Tensor, wanted: Tensor, weights: Sequence[float]) -> Tensor:
    """Return the weighted cross-entropy of the classes of points.

    Args:
        said: (N, classes) logits.
        wanted: (N,) class indices.
        weights: weight of each class.
    """
    if not len(wanted):
        return said.sum() * 0
    return functional.cross_entropy(said.float(), wanted, weight=said.new_tensor(weights).float())
