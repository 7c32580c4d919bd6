"""Frames of several recordings from above, side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from urbantwin.drawing import style
from urbantwin.drawing.labelled_frame import LabelledPoints

__all__ = ["cells_picture"]

#: Pictures in a row, and edge of each, inches.
_ACROSS, _EDGE = 4, 3.6


def cells_picture(
    frames: Sequence[tuple[str, LabelledPoints]],
    path: Path,
    *,
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw frames from above, points by class.

    Args:
        frames: title and frame of each, at least one.
        path: the PNG to write.
        attribution: sources of the data.
    """
    across = min(_ACROSS, len(frames))
    down = math.ceil(len(frames) / across)
    height = down * (_EDGE + 0.3) + 0.3
    figure = style.new_figure(across * _EDGE, height)
    for number, (title, frame) in enumerate(frames):
        row, column = divmod(number, across)
        low = height - (row + 1) * (_EDGE + 0.3)
        axes = figure.add_axes((column / across, low / height, 0.98 / across, _EDGE / height))
        style.bare(axes)
        centre = np.zeros(2)
        if frame.sensors:
            places = [one.dataset_SE3_sensor.translation[:2] for one in frame.sensors]
            centre = np.mean(places, axis=0)
        reach = 50.0
        axes.set_xlim(centre[0] - reach, centre[0] + reach)
        axes.set_ylim(centre[1] - reach, centre[1] + reach)
        order = np.argsort(frame.points[:, 2], kind="stable")
        for chosen, size in ((frame.instance[order] == 0, 0.4), (frame.instance[order] > 0, 1.6)):
            index = order[chosen]
            colours = style.class_colours(frame.semantic[index])
            axes.scatter(
                frame.points[index, 0], frame.points[index, 1], s=size, c=colours, linewidths=0
            )
        axes.set_title(title, color=style.INK, fontsize=8, pad=3)
    style.written_attribution(figure, attribution)
    return style.save(figure, path)
