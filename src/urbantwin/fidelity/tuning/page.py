"""The report of a fit: a picture, and one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from urbantwin.artefact import read_json
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.tuning.fit import RigFit
from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.tuned_rig import SimulatedFrames
from urbantwin.pages import write_page

__all__ = ["write_report"]

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from urbantwin.fidelity.frame import Frame

__all__ = ["draw_fit"]

_COLOURS = {"real": "#1d2733", "start": "#e8710a", "tuned": "#1a73e8"}
_RANGES, _HEIGHTS = np.linspace(0, 100, 51), np.linspace(-12, 12, 61)
_LIGHTS = np.linspace(0, 0.6, 41)


def draw_fit(
    fit: RigFit, parts: dict[str, dict[str, Sequence[Frame]]], scale: float | None, path: Path
) -> None:
    """Draw the loss of every group, and distributions of every part.

    Args:
        fit: result of the fit.
        parts: by part (``training``, ``held out``) the frames of ``real``, ``start``, ``tuned``.
        scale: full scale of real intensity; ``None`` without intensity.
        path: the PNG.
    """
    figure = Figure(figsize=(15, 4.2 * (1 + len(parts))), layout="constrained", dpi=90)
    grid = figure.add_gridspec(1 + len(parts), 3)
    first = figure.add_subplot(grid[0, :])
    for one in fit.groups:
        scaled = np.array(one.history)
        low, high = scaled.min(), max(scaled.max(), scaled.min() + 1e-12)
        first.plot((scaled - low) / (high - low), label=one.name, linewidth=1.6)
    first.set(title="Best loss so far of every group (1: its start, 0: its end)", xlabel="trial")
    if fit.groups:
        first.legend(frameon=False)
    for row, (part, sides) in enumerate(parts.items(), start=1):
        axes = [figure.add_subplot(grid[row, column]) for column in range(3)]
        for name, frames in sides.items():
            full = scale if name == "real" and scale else 1.0
            away = np.concatenate([_range(one) for one in frames])
            _outline(axes[0], away, _RANGES, len(frames), name)
            up = np.concatenate([one.points[:, 2] for one in frames])
            _outline(axes[1], up, _HEIGHTS, len(frames), name)
            if scale is not None:
                light = np.concatenate([np.asarray(one.intensity) for one in frames]) / full
                _outline(axes[2], light, _LIGHTS, len(frames), name)
        axes[0].set(title=f"{part.capitalize()}: range", xlabel="m", ylabel="points a frame")
        axes[1].set(title=f"{part.capitalize()}: height", xlabel="m")
        axes[2].set(title=f"{part.capitalize()}: intensity", xlabel="of full scale")
        axes[0].legend(frameon=False)
    for axis in figure.axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.title.set_fontsize(11)
    figure.savefig(path, metadata={"Software": None})


def _range(frame: Frame) -> np.ndarray:
    return np.asarray(np.linalg.norm(frame.points - frame.sensor_places[0], axis=1))


def _outline(axis: Axes, values: np.ndarray, edges: np.ndarray, frames: int, name: str) -> None:
    count, _ = np.histogram(values, edges)
    wide = 2.4 if name == "real" else 1.4
    style = "--" if name == "start" else "-"
    axis.stairs(
        count / max(frames, 1), edges, color=_COLOURS[name], label=name, linewidth=wide, ls=style
    )


#: Number of frames of each part in the distributions.
_DRAWN = 4


def write_report(
    out: Path,
    fit: RigFit,
    judged: dict[str, Any],
    training: Looks,
    held: Looks,
    sides: dict[str, SimulatedFrames],
    scale: float | None,
) -> None:
    """Write ``report.html`` and ``report.png`` beside ``tuning.json``.

    Args:
        out: the folder of the fit.
        fit: result of the fit.
        judged: contents of ``held_out.json``.
        training: the training frames.
        held: the held-out frames.
        sides: simulated frames of the rig at ``start`` and ``tuned``.
        scale: full scale of real intensity.
    """
    few = range(_DRAWN)
    made = {name: [side.frame(k) for k in few] for name, side in sides.items()}
    parts = {
        part: {"real": looks.clouds[:: max(1, looks.frames // _DRAWN)][:_DRAWN], **made}
        for part, looks in (("training", training), ("held out", held))
    }
    draw_fit(fit, parts, None if training.intensity is None else scale, out / "report.png")
    write_page(
        out / "report.html",
        "fidelity/tuning/page.html.j2",
        fit=read_json(out / "tuning.json", kind="tuning"),
        judged=judged,
        measures=MEASURES,
        drawn=out / "report.png",
    )
