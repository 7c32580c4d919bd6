"""A model as an ONNX file, for programs without torch."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import torch

from urbantwin.learn.grid import Grid
from urbantwin.learn.model import Model
from urbantwin.learn.network import inputs_of
from urbantwin.learn.pillars import pillars_of, told_of_points

__all__ = ["INPUTS", "OF_POINTS", "write_onnx"]

#: What the file takes: see `network.Detector.forward`. The grid is that of the model's range.
INPUTS = ("features", "points", "cell")
#: And where it tells classes of points.
OF_POINTS = ("told", "at")
_OPSET = 17


def write_onnx(file: Path, model: Model) -> None:
    """Write a model: the pillars of one frame, however many, to the maps of each class.

    Where it tells classes of points, it is asked for any number of these, too (``of_points``).

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
    given: tuple[torch.Tensor, ...] = inputs_of(pillars_of(points, grid), grid.cells, "cpu")
    inputs, outputs = [*INPUTS, "shape"], list(model.design.classes)
    dynamic = {name: {0: "pillars"} for name in INPUTS}
    if model.design.points:
        told, at, _ = told_of_points(points, grid)
        given = (*given, torch.from_numpy(told), torch.from_numpy(at))
        inputs, outputs = [*inputs, *OF_POINTS], [*outputs, "of_points"]
        dynamic |= {name: {0: "asked"} for name in (*OF_POINTS, "of_points")}
    with warnings.catch_warnings():  # of what later versions of torch prefer
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            given,
            str(file),
            input_names=inputs,
            output_names=outputs,
            dynamic_axes=dynamic,
            opset_version=_OPSET,
            dynamo=False,
        )
