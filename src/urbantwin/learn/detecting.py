"""Inference: detections in the frames of a recording."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from urbantwin.detections import Detections, joined
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.learn.decoding import LEAST_SCORE, Found, boxes_of_maps
from urbantwin.learn.frames import levelled, refuse_upside_down
from urbantwin.learn.grid import Grid
from urbantwin.learn.model import Model
from urbantwin.learn.network import inputs_of
from urbantwin.learn.pillars import pillars_of, told_of_points
from urbantwin.learn.second_look.scoring import looked_again
from urbantwin.learn.views import VIEWS
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import semantic_id

__all__ = ["detected", "found_in"]


def found_in(
    model: Model,
    frame: Frame,
    *,
    device: str = "cpu",
    least: float = LEAST_SCORE,
    views: int = 1,
) -> tuple[Found, NDArray[np.uint8] | None]:
    """Detect objects in one frame; return boxes in the frame of its points, and point classes.

    Point classes (N,) are ids of ``taxonomy.semantic_classes``, 0 beyond the model's range; None
    for a model without them.

    Args:
        model: trained detector.
        frame: frame of any sensor.
        device: device of the model's network.
        least: lowest score of returned boxes.
        views: number of `VIEWS` for test-time augmentation: outputs of boxes are averaged over
            them; point classes are those of the first.
    """
    design = model.design
    level = levelled(frame, design.range_m, intensity=design.intensity)
    points = level.frame.points
    grid = Grid.around(0.0, 0.0, design.range_m, design.cell_m)
    semantic, asked = None, []
    with torch.inference_mode():
        if design.points:
            told, at, inside = told_of_points(points, grid)
            asked = [torch.from_numpy(told).to(device), torch.from_numpy(at).to(device)]
        seen = []
        for number, view in enumerate(VIEWS[:views]):
            given = inputs_of(pillars_of(view.points(points), grid), grid.cells, device)
            said = model.network(*given, *(asked if number == 0 else ()))
            if asked and number == 0:
                ids = np.array([semantic_id(name) for name in design.points], np.uint8)
                semantic = np.zeros(len(frame.points), np.uint8)
                semantic[level.kept[inside]] = ids[said.pop().argmax(dim=1).cpu().numpy()]
            seen.append([view.back(one[0].float().cpu().numpy()) for one in said])
    maps = [np.mean(of_class, axis=0) for of_class in zip(*seen, strict=True)]
    look = model.second_look
    found = boxes_of_maps(maps, grid, design.heads, min(least, LEAST_SCORE) if look else least)
    if look is not None:
        found = looked_again(look, found, points, level.frame.sensors, design.classes, device)
        found = found.only(found.score >= least)
    box = found.box.copy()
    box[:, :2] += level.middle
    box[:, 2] += level.ground.at(box)
    return Found(box, found.number, found.score), semantic


def detected(
    model: Model,
    recording: Recording,
    *,
    device: str = "cpu",
    least: float = LEAST_SCORE,
    views: int = 1,
    semantic: Callable[[str, NDArray[np.uint8]], None] | None = None,
    tell: Progress,
) -> Detections:
    """Detect objects in all frames of a recording.

    Args:
        model: trained detector.
        recording: recording of any sensor.
        device: device of the model's network.
        least: lowest score of returned boxes.
        views: number of `VIEWS` for test-time augmentation.
        semantic: called with the name of each frame and its point classes, if the model has any.
        tell: progress callback.

    Raises:
        InputError: the model has no head, z points down, or the model needs intensities that the
            frames do not have.
    """
    if not model.design.classes and not model.design.points:
        raise InputError(
            "the model has no output: it was only pre-trained",
            expected="a model of `urbantwin model train`, which may begin --from this one",
        )
    names: list[str] = []
    rows: list[tuple[NDArray[np.float64], list[str], NDArray[np.float64]]] = []
    for number in each(range(len(recording)), tell, "detecting"):
        frame = recording.read(number)
        if not len(frame.points):  # a sweep without returns
            names.append(frame.name)
            rows.append((np.zeros((0, 7)), [], np.zeros(0)))
            continue
        refuse_upside_down(frame, recording.path)
        if model.design.intensity and frame.intensity is None:
            raise InputError(
                "has no intensities, which the model was trained with",
                file=recording.path,
                place=f"frame {frame.name}",
                expected="0 to 1, or a model without intensities",
            )
        found, of_points = found_in(model, frame, device=device, least=least, views=views)
        if semantic is not None and of_points is not None:
            semantic(frame.name, of_points)
        classes = [model.design.classes[one] for one in found.number]
        names.append(frame.name)
        rows.append((found.box, classes, np.asarray(found.score)))
    return joined(names, rows)
