"""What a model detects in frames."""

from __future__ import annotations

import numpy as np
import torch

from urbantwin.detections import Detections, joined
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.learn.decoding import LEAST_SCORE, Found, boxes_of_maps
from urbantwin.learn.frames import levelled, refuse_upside_down
from urbantwin.learn.grid import Grid
from urbantwin.learn.model import Model
from urbantwin.learn.pillars import pillars_of
from urbantwin.learn.training import inputs_of
from urbantwin.progress import Progress, each

__all__ = ["detected", "found_in"]


def found_in(
    model: Model, frame: Frame, *, device: str = "cpu", least: float = LEAST_SCORE
) -> Found:
    """Return what a model finds in one frame, in the frame of its points.

    Args:
        model: a detector.
        frame: of any sensor.
        device: where the model's network is.
        least: boxes that are less likely are left out.
    """
    design = model.design
    level, ground, middle = levelled(frame, design.range_m, intensity=design.intensity)
    grid = Grid.around(0.0, 0.0, design.range_m, design.cell_m)
    with torch.inference_mode():
        said = model.network(*inputs_of(pillars_of(level.points, grid), grid.cells, device))
        maps = [one[0].float().cpu().numpy() for one in said]
    found = boxes_of_maps(maps, grid, design.heads, least)
    box = found.box.copy()
    box[:, :2] += middle
    box[:, 2] += ground.at(box)
    return Found(box, found.number, found.score)


def detected(
    model: Model,
    recording: Recording,
    *,
    device: str = "cpu",
    least: float = LEAST_SCORE,
    tell: Progress,
) -> Detections:
    """Return what a model finds in the frames of a recording.

    Args:
        model: a detector.
        recording: of any sensor.
        device: where the model's network is.
        least: boxes that are less likely are left out.
        tell: called with the share that is done.

    Raises:
        InputError: z points down, or intensities are wanted that the frames do not have.
    """
    names, rows = [], []
    for number in each(range(len(recording)), tell, "detecting"):
        frame = recording.read(number)
        refuse_upside_down(frame, recording.path)
        if model.design.intensity and frame.intensity is None:
            raise InputError(
                "has no intensities, which the model was trained with",
                file=recording.path,
                place=f"frame {frame.name}",
                expected="0 to 1, or a model without intensities",
            )
        found = found_in(model, frame, device=device, least=least)
        classes = [model.design.classes[one] for one in found.number]
        names.append(frame.name)
        rows.append((found.box, classes, np.asarray(found.score)))
    return joined(names, rows)
