"""The network: pillar encoder, bird's-eye-view backbone, a head for each class, a point head.

PointPillars (Lang et al. 2019) for the encoder, CenterPoint (Yin, Zhou and Kraehenbuehl 2021,
"Center-based 3D Object Detection and Tracking") for the heads, and a feature pyramid (Lin et al.
2017, "Feature Pyramid Networks for Object Detection") back to the finest cells for small classes.
Strided convolutions first bring finer pillars to cells of that size. The point head classifies a
point by the features of its cell and its position in it. Tensors are NCHW on a processor, where
the backward pass of a strided convolution is 35 times slower with channels last; on a GPU they are
channels-last, for its matrix units.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from urbantwin.learn.heads import OUTPUTS, ClassHead
from urbantwin.learn.pillars import MOST_POINTS, Pillars, told_of_point

__all__ = ["Detector", "inputs_of"]

#: Channels at strides 1, 2, 4 and 8 of the network of width 1.
_CHANNELS = (32, 48, 64, 96)
#: Channels of the layer of each head, and of the point head.
_OWN, _OF_POINTS = 16, 48
#: Initial bias of a head: one cell in a hundred is a centre (Lin et al. 2017, focal loss).
_AT_FIRST = -math.log((1 - 0.01) / 0.01)


def _layer(ins: int, outs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(ins, outs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outs, eps=1e-3, momentum=0.03),
        nn.ReLU(inplace=True),
    )


class _PillarEncoder(nn.Module):
    """A linear layer for each point, then the maximum over each pillar."""

    def __init__(self, features: int, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(features, channels, bias=False)
        self.norm = nn.BatchNorm1d(channels, eps=1e-3, momentum=0.03)

    def forward(self, features: Tensor, points: Tensor) -> Tensor:
        """Return pillar features (P, channels); see `Detector.forward`."""
        pillars = points.shape[0]
        if features.dim() == 2:  # training: unused rows must not enter the batch mean
            value = torch.relu(self.norm(self.linear(features)))
            # No value of a tensor is read, so that the host need not wait for the device.
            rows, number = len(features), torch.arange(pillars, device=points.device)
            owner = torch.repeat_interleave(number, points, output_size=rows)
            first = torch.cumsum(points, 0) - points
            place = torch.arange(rows, device=points.device) - first[owner]
            whole = value.new_zeros((pillars * MOST_POINTS, value.shape[1]))
            whole = whole.index_copy(0, owner * MOST_POINTS + place, value)
            return whole.reshape(pillars, MOST_POINTS, -1).amax(dim=1)
        most = features.shape[1]
        filled = torch.arange(most, device=points.device)[None] < points[:, None]
        # With zero pillars, -1 as a dimension would be ambiguous.
        value = self.norm(self.linear(features.reshape(pillars * most, features.shape[2])))
        value = torch.relu(value).reshape(pillars, most, value.shape[1]) * filled[:, :, None]
        return value.amax(dim=1)


class Detector(nn.Module):
    """Maps pillars to maps of centres and boxes.

    Args:
        features: number of features of a point in a pillar.
        heads: heads of the classes.
        width: multiple of the number of channels; 1 suits two processor cores.
        points: number of semantic classes of the point head; 0: no point head.
        merged: how often pillars are merged 2 x 2 before the backbone (`grid.halvings`).
    """

    def __init__(
        self,
        features: int,
        heads: Sequence[ClassHead],
        width: float = 1.0,
        points: int = 0,
        merged: int = 0,
    ) -> None:
        super().__init__()
        one, two, four, eight = (8 * max(1, round(width * count / 8)) for count in _CHANNELS)
        own = 8 * max(1, round(width * _OWN / 8))
        self.channels = one
        self.encoder = _PillarEncoder(features, one)
        self.merged = nn.Sequential(*(_layer(one, one, stride=2) for _ in range(merged)))
        self.near = _layer(one, one)
        self.down2 = nn.Sequential(_layer(one, two, stride=2), _layer(two, two), _layer(two, two))
        self.down4 = nn.Sequential(
            _layer(two, four, stride=2), *(_layer(four, four) for _ in range(3))
        )
        self.down8 = nn.Sequential(
            _layer(four, eight, stride=2), *(_layer(eight, eight) for _ in range(3))
        )
        self.up4 = _layer(eight, four, kernel=1)
        self.merge4 = _layer(four, four)
        self.up2 = _layer(four, two, kernel=1)
        self.merge2 = _layer(two, two)
        self.strides = tuple(head.stride >> merged for head in heads)
        self.is_fine = 1 in self.strides or bool(points) or not heads
        if self.is_fine:
            self.up1 = _layer(two, one, kernel=1)
            self.merge1 = _layer(one, one)
        self.heads = nn.ModuleList()
        for stride in self.strides:
            last = nn.Conv2d(own, OUTPUTS, 1)
            nn.init.normal_(last.weight, std=0.01)
            bias = torch.zeros(OUTPUTS)
            bias[0] = _AT_FIRST
            last.bias = nn.Parameter(bias)
            self.heads.append(nn.Sequential(_layer(one if stride == 1 else two, own), last))
        self.of_points: nn.Sequential | None = None
        if points:
            wide = 8 * max(1, round(width * _OF_POINTS / 8))
            self.of_points = nn.Sequential(
                nn.Linear(one + told_of_point(features), wide),
                nn.ReLU(inplace=True),
                nn.Linear(wide, points),
            )

    def forward(
        self,
        features: Tensor,
        points: Tensor,
        cell: Tensor,
        shape: Tensor,
        told: Tensor | None = None,
        at: Tensor | None = None,
    ) -> list[Tensor]:
        """Return (grids, `OUTPUTS`, rows, columns) for each class, then (N, classes) for points.

        Args:
            features: (P, M, features) of pillars; in training (N, features) of their points,
                pillar by pillar.
            points: (P,) int64: number of points of each pillar.
            cell: (P,) int64: cell of each pillar.
            shape: (grids, 0, rows, columns): an empty tensor with the shape of the batch.
            told: (N, `told_of_point`): features of the points to classify, if any.
            at: (N,) int64: cell of each of these points.
        """
        fine, half = self.maps(features, points, cell, shape)
        said = self.said_of(fine, half)
        if self.of_points is not None and told is not None and at is not None:
            cells = fine.permute(0, 2, 3, 1).reshape(-1, self.channels)
            at = self._merged_cell(at, shape.shape[2], shape.shape[3])
            said.append(self.of_points(torch.cat([cells.index_select(0, at), told], dim=1)))
        return said

    def _merged_cell(self, cell: Tensor, rows: int, columns: int) -> Tensor:
        """Return the merged cell of each pillar cell."""
        step = 1 << len(self.merged)
        if step == 1:
            return cell
        grid, within = cell // (rows * columns), cell % (rows * columns)
        row, column = within // columns // step, within % columns // step
        return (grid * (rows // step) + row) * (columns // step) + column

    def said_of(self, fine: Tensor, half: Tensor) -> list[Tensor]:
        """Return (grids, `OUTPUTS`, rows, columns) for each class; see `maps_of_cells`."""
        return [
            head(fine if stride == 1 else half)
            for head, stride in zip(self.heads, self.strides, strict=True)
        ]

    def maps(
        self, features: Tensor, points: Tensor, cell: Tensor, shape: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the features at strides 1 and 2; see `forward`."""
        grids, rows, columns = shape.shape[0], shape.shape[2], shape.shape[3]
        pillar = self.encoder(features, points)
        canvas = pillar.new_zeros((grids * rows * columns, self.channels))
        canvas = canvas.index_copy(0, cell, pillar)
        if canvas.is_cuda:  # channels-last already
            canvas = canvas.reshape(grids, rows, columns, -1).permute(0, 3, 1, 2)
        else:
            canvas = canvas.reshape(grids, rows * columns, -1).transpose(1, 2).contiguous()
            canvas = canvas.reshape(grids, -1, rows, columns)
        return self.maps_of_cells(canvas)

    def maps_of_cells(self, canvas: Tensor) -> tuple[Tensor, Tensor]:
        """Return the features (grids, channels, rows, columns) at strides 1 and 2.

        Args:
            canvas: (grids, channels, rows, columns): pillar features, 0 in empty cells; pillars of
                several sensors are max-pooled.
        """
        fine = self.near(self.merged(canvas))
        half = self.down2(fine)
        quarter = self.down4(half)
        eighth = self.down8(quarter)
        quarter = self.merge4(quarter + _doubled(self.up4(eighth)))
        half = self.merge2(half + _doubled(self.up2(quarter)))
        fine = self.merge1(fine + _doubled(self.up1(half))) if self.is_fine else fine
        return fine, half


def _doubled(cells: Tensor) -> Tensor:
    return functional.interpolate(cells, scale_factor=2.0, mode="nearest")


def inputs_of(pillars: Pillars, cells: int, device: str) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the arguments of `Detector.forward` for pillars of a grid with ``cells`` an edge."""
    features, points, cell = (
        torch.from_numpy(one).to(device) for one in (pillars.features, pillars.points, pillars.cell)
    )
    return features, points, cell, torch.zeros((1, 0, cells, cells), device=device)
