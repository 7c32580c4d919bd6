"""Network of the second stage: a PointNet with global features added to each point.

Qi et al. 2017, "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation".
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from urbantwin.learn.second_look.crop import TOLD

__all__ = ["SecondLook"]

#: Channels of the first layers, and features of a point.
_CHANNELS, _OF_POINT = 32, 5
#: Radius about the centre of the box within which points are flagged, metres.
_WITHIN_M = 0.5


def _layer(ins: int, outs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(ins, outs), nn.BatchNorm1d(outs), nn.ReLU(inplace=True))


class SecondLook(nn.Module):
    """Maps crops to log-odds.

    Args:
        classes: number of classes of the detector.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        wide = _CHANNELS
        self.classes = classes
        self.each = nn.Sequential(_layer(_OF_POINT, wide), _layer(wide, wide))
        self.again = nn.Sequential(_layer(2 * wide, 2 * wide), _layer(2 * wide, 4 * wide))
        self.said = nn.Sequential(
            nn.Linear(4 * wide + TOLD + classes, 2 * wide),
            nn.ReLU(inplace=True),
            nn.Linear(2 * wide, 1),
        )

    def forward(self, points: Tensor, told: Tensor, number: Tensor) -> Tensor:
        """Return the log-odds (K,) that detections are right; see `crop.Crops`."""
        boxes, most = points.shape[0], points.shape[1]
        apart = torch.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        within = (apart < _WITHIN_M).to(points.dtype)
        value = torch.cat([points, apart[..., None], within[..., None]], dim=2)
        value = self.each(value.reshape(boxes * most, _OF_POINT)).reshape(boxes, most, -1)
        together = value.amax(dim=1, keepdim=True).expand(-1, most, -1)
        value = torch.cat([value, together], dim=2).reshape(boxes * most, 2 * value.shape[2])
        value = self.again(value).reshape(boxes, most, -1).amax(dim=1)
        kind = functional.one_hot(number, self.classes).to(value.dtype)
        odds: Tensor = self.said(torch.cat([value, told, kind], dim=1))
        return odds[:, 0]
