"""Export of a model to ONNX, for programs without torch."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from urbantwin.learn.grid import Grid
from urbantwin.learn.model import Model
from urbantwin.learn.network import inputs_of
from urbantwin.learn.pillars import pillars_of, told_of_points
from urbantwin.learn.second_look.crop import CROP_POINTS, TOLD
from urbantwin.learn.second_look.network import SecondLook

__all__ = ["CROPS", "INPUTS", "OF_POINTS", "write_onnx"]

#: Inputs of the detector's file, see `network.Detector.forward`; the grid covers the model's range.
INPUTS = ("features", "points", "cell")
#: Further inputs of a model with a point head.
OF_POINTS = ("told", "at")
#: Inputs of the second stage's file, see `second_look.crop.Crops`.
CROPS = ("points", "told", "number")
_OPSET = 17


def write_onnx(folder: Path, model: Model) -> None:
    """Write ``model.onnx``, and ``second_look.onnx`` for a model with a second stage.

    ``model.onnx`` maps any number of pillars of one frame to the maps of each class, and any number
    of points to their classes (``of_points``). ``second_look.onnx`` maps the crops of any number of
    boxes to log-odds.

    Args:
        folder: folder to write into.
        model: model on any device.
    """
    _write_detector(folder / "model.onnx", model)
    if model.second_look is not None:
        _write_second_look(folder / "second_look.onnx", model.second_look)


def _write_detector(file: Path, model: Model) -> None:
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
    _exported(file, network, given, inputs, outputs, dynamic)


def _write_second_look(file: Path, look: SecondLook) -> None:
    given = (
        torch.zeros((2, CROP_POINTS, 3)),
        torch.zeros((2, TOLD)),
        torch.zeros(2, dtype=torch.int64),
    )
    dynamic = {name: {0: "boxes"} for name in (*CROPS, "log_odds")}
    _exported(file, look.cpu().eval(), given, CROPS, ("log_odds",), dynamic)


def _exported(
    file: Path,
    network: torch.nn.Module,
    given: tuple[torch.Tensor, ...],
    inputs: Sequence[str],
    outputs: Sequence[str],
    dynamic: Mapping[str, Mapping[int, str]],
) -> None:
    with warnings.catch_warnings():  # torch deprecates this exporter
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            given,
            str(file),
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes={name: dict(axes) for name, axes in dynamic.items()},
            opset_version=_OPSET,
            dynamo=False,
        )
