"""The network: pillars, a backbone seen from above, a head for each class, and one for points.

PointPillars (Lang et al. 2019) for the encoder, CenterPoint (Yin, Zhou and Kraehenbuehl 2021,
"Center-based 3D Object Detection and Tracking") for the heads, and a pyramid (Lin et al. 2017,
"Feature Pyramid Networks for Object Detection") that leads back to the finest cells, so that people
have heads there. Finer pillars are brought to cells of that size by strided convolutions first. A
point's class is told by its cell and by where it is in its pillar. Tensors are NCHW: channels last,
the backward pass of a convolution with stride 2 is 35 times slower on a processor; on a GPU they
lie with channels last, as its matrix units read them.
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

#: Channels in cells 1, 2, 4 and 8 times as large as the finest, of the smallest network.
_CHANNELS = (32, 48, 64, 96)
#: Of a class's own layer, and of the one that tells classes of points.
_OWN, _OF_POINTS = 16, 48
#: What a head says at first: one cell in a hundred is a centre (Lin et al. 2017, focal loss).
_AT_FIRST = -math.log((1 - 0.01) / 0.01)


def _layer(ins: int, outs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(ins, outs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outs, eps=1e-3, momentum=0.03),
        nn.ReLU(inplace=True),
    )


class _PillarEncoder(nn.Module):
    """A linear layer for each point and the largest values of each pillar."""

    def __init__(self, features: int, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(features, channels, bias=False)
        self.norm = nn.BatchNorm1d(channels, eps=1e-3, momentum=0.03)

    def forward(self, features: Tensor, points: Tensor) -> Tensor:
        """Return (P, channels) for pillars with some points each; see `Detector.forward`."""
        pillars = points.shape[0]
        if features.dim() == 2:  # in training: what is no point must not count for the mean
            value = torch.relu(self.norm(self.linear(features)))
            # Of no tensor a value is asked, so that a device need not be waited for.
            rows, number = len(features), torch.arange(pillars, device=points.device)
            owner = torch.repeat_interleave(number, points, output_size=rows)
            first = torch.cumsum(points, 0) - points
            place = torch.arange(rows, device=points.device) - first[owner]
            whole = value.new_zeros((pillars * MOST_POINTS, value.shape[1]))
            whole = whole.index_copy(0, owner * MOST_POINTS + place, value)
            return whole.reshape(pillars, MOST_POINTS, -1).amax(dim=1)
        most = features.shape[1]
        filled = torch.arange(most, device=points.device)[None] < points[:, None]
        # Of no pillars -1 would say nothing.
        value = self.norm(self.linear(features.reshape(pillars * most, features.shape[2])))
        value = torch.relu(value).reshape(pillars, most, value.shape[1]) * filled[:, :, None]
        return value.amax(dim=1)


class Detector(nn.Module):
    """From pillars to maps of centres and boxes.

    Args:
        features: values of each point of a pillar.
        heads: the classes.
        width: multiple of the channels; 1 for two processors.
        points: how many classes of points it tells; none without the head for them.
        merged: how often pillars are merged two by two to the finest cells (`grid.halvings`).
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
        """Return (grids, `OUTPUTS`, rows, columns) for each class, and (N, classes) of points.

        Args:
            features: (P, M, features) of pillars; in training (N, features), their points alone,
                one pillar's after the other's.
            points: (P,) int64, how many points each has.
            cell: (P,) int64.
            shape: (grids, 0, rows, columns): a tensor whose shape is that of the batch.
            told: (N, `told_of_point`) of points whose class is asked for, if it tells any.
            at: (N,) int64, the cell of each of these.
        """
        fine, half = self.maps(features, points, cell, shape)
        said = self.said_of(fine, half)
        if self.of_points is not None and told is not None and at is not None:
            cells = fine.permute(0, 2, 3, 1).reshape(-1, self.channels)
            at = self._merged_cell(at, shape.shape[2], shape.shape[3])
            said.append(self.of_points(torch.cat([cells.index_select(0, at), told], dim=1)))
        return said

    def _merged_cell(self, cell: Tensor, rows: int, columns: int) -> Tensor:
        """Return the numbers of the finest cells that pillars are merged to, of their own."""
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
        """Return what is known of the finest cells, and of cells twice as large; see `forward`."""
        grids, rows, columns = shape.shape[0], shape.shape[2], shape.shape[3]
        pillar = self.encoder(features, points)
        canvas = pillar.new_zeros((grids * rows * columns, self.channels))
        canvas = canvas.index_copy(0, cell, pillar)
        if canvas.is_cuda:  # where tensors lie with channels last, as they do here already
            canvas = canvas.reshape(grids, rows, columns, -1).permute(0, 3, 1, 2)
        else:
            canvas = canvas.reshape(grids, rows * columns, -1).transpose(1, 2).contiguous()
            canvas = canvas.reshape(grids, -1, rows, columns)
        return self.maps_of_cells(canvas)

    def maps_of_cells(self, canvas: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is known of the finest cells and of larger ones: (grids, channels, ...).

        Args:
            canvas: (grids, channels, rows, columns) what the encoder says of each pillar, 0 where
                there is none; pillars of several sensors are max-pooled.
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
    """Return what `Detector.forward` takes for the pillars of a grid of ``cells`` each way."""
    features, points, cell = (
        torch.from_numpy(one).to(device) for one in (pillars.features, pillars.points, pillars.cell)
    )
    return features, points, cell, torch.zeros((1, 0, cells, cells), device=device)
