"""Some frames of a dataset from above, as a moving picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from PIL import Image

from urbantwin.view.birdseye import birdseye_figure
from urbantwin.view.labelled_frame import LabelledPoints

__all__ = ["sequence"]


def sequence(
    frames: Sequence[LabelledPoints],
    path: Path,
    *,
    seconds_per_frame: float = 0.1,
    reach_m: float = 60.0,
    dpi: int = 60,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Write an animated GIF of frames from above, all of them at one scale.

    Args:
        frames: at least one.
        path: the GIF to write.
        seconds_per_frame: how long each is shown; GIF counts in hundredths of a second.
        reach_m: half the side of what is shown.
        dpi: pixels per inch of 14.4 x 12 inches.
        title: of the picture.
        attribution: whose data it shows.
    """
    if not frames:
        raise ValueError("a sequence needs at least one frame")
    pictures = []
    sources = attribution if isinstance(attribution, str) else tuple(attribution)
    for frame in frames:
        figure = birdseye_figure(frame, reach_m=reach_m, title=title, attribution=sources)
        figure.set_dpi(dpi)
        canvas = cast(Any, figure.canvas)  # the Agg canvas of `new_figure`
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
        pictures.append(Image.fromarray(pixels.copy()).quantize(128, dither=Image.Dither.NONE))
    pictures[0].save(
        path,
        save_all=True,
        append_images=pictures[1:],
        duration=round(seconds_per_frame * 100) * 10,
        loop=0,
    )
    return path
