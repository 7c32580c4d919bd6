"""A model as an ONNX file, for programs without torch."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import torch

from urbantwin.learn.grid import Grid
from urbantwin.learn.model import Model
from urbantwin.learn.pillars import pillars_of
from urbantwin.learn.training import inputs_of

__all__ = ["INPUTS", "write_onnx"]

#: What the file takes: see `network.Detector.forward`. The grid is that of the model's range.
INPUTS = ("features", "points", "cell")
_OPSET = 17


def write_onnx(file: Path, model: Model) -> None:
    """Write a model: the pillars of one frame, however many, to the maps of each class.

    Args:
        file: to write.
        model: on any device.
    """
    grid = Grid.around(0.0, 0.0, model.design.range_m, model.design.cell_m)
    draw = np.random.default_rng(0)
    half = model.design.range_m
    points = draw.uniform((-half, -half, 0), (half, half, 2), (500, 3)).astype(np.float32)
    if model.design.intensity:
        points = np.column_stack([points, np.full(len(points), 0.5, np.float32)])
    network = model.network.cpu().eval()
    with warnings.catch_warnings():  # of what later versions of torch prefer
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            inputs_of(pillars_of(points, grid), grid.cells, "cpu"),
            str(file),
            input_names=[*INPUTS, "shape"],
            output_names=list(model.design.classes),
            dynamic_axes={name: {0: "pillars"} for name in INPUTS},
            opset_version=_OPSET,
            dynamo=False,
        )
