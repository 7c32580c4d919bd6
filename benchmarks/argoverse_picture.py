"""The Argoverse pair as a picture: range images above each other, boxes, beams, lost rays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["draw"]


def draw(sweep: Sequence[Any], result: dict[str, Any], path: Path) -> None:
    """Write the picture of one sweep's pairs and of the figures of both sweeps."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(17, 15), layout="constrained")
    grid = figure.add_gridspec(6, 3, height_ratios=[1, 1, 1, 1, 2.2, 0.01])
    for number, pair in enumerate(sweep):
        upwards = np.argsort(pair.real.elevation_deg)
        order = upwards[::-1] if number == 0 else upwards
        for row, (name, image) in enumerate(
            (("real", pair.real.range_m), ("simulated: ground and boxes alone", pair.range_m))
        ):
            axes = figure.add_subplot(grid[2 * number + row, :])
            shown = axes.imshow(
                image[order], aspect="auto", interpolation="nearest", cmap="turbo_r",
                norm=mpl.colors.LogNorm(4, 120),
            )  # fmt: skip
            axes.set(yticks=[], xticks=[])
            axes.set_ylabel("upper" if number == 0 else "lower")
            axes.set_title(name, loc="left", fontsize=10)
    figure.colorbar(shown, ax=figure.axes, label="range, m", pad=0.01)

    axes = figure.add_subplot(grid[4, 0])
    for rows, mark in zip(result["box_rows"], "o^", strict=True):
        judged = [row for row in rows if row["real"] > 20]
        for kind, colour in (("VEHICLE", "C0"), ("PEDESTRIAN", "C3"), ("CYCLE", "C2"), ("", "0.5")):
            mine = [row for row in judged if kind in row["category"]]
            judged = [row for row in judged if kind not in row["category"]]
            axes.loglog(
                [row["real"] for row in mine], [max(row["simulated"], 1) for row in mine],
                mark, color=colour, ms=5, alpha=0.7,
                label=kind.lower() or "other" if mark == "o" else None,
            )  # fmt: skip
    line = np.array([15, 3500])
    axes.loglog(line, line, "k-", lw=0.8)
    axes.fill_between(line, 0.8 * line, 1.25 * line, color="0.85")
    axes.set(xlabel="real points in the box", ylabel="simulated points in the box")
    axes.legend(fontsize=8)

    axes = figure.add_subplot(grid[4, 1])
    for name in ("up_lidar", "down_lidar"):
        rows = [row for row in result["ground_per_beam"] if row["sensor"] == name]
        axes.errorbar(
            [row["range_m"] for row in rows], [row["median_m"] for row in rows],
            [row["sigma_m"] for row in rows], fmt="o", ms=4, lw=0.8, label=name,
        )  # fmt: skip
    axes.axhline(0, color="k", lw=0.6)
    axes.set(xlabel="range on the ground, m", ylabel="real less simulated, m", ylim=(-3, 3))
    axes.legend(fontsize=8)

    axes = figure.add_subplot(grid[4, 2])
    for key, colour in (("dropout_ground", "C5"), ("dropout_actors", "C0")):
        rows = result[key]
        middle = [(row["from_m"] + row["to_m"]) / 2 for row in rows]
        for who, style in (("real", "-"), ("simulated", "--")):
            axes.plot(
                middle, [100 * row[who] for row in rows], style, marker=".", color=colour,
                label=f"{key.removeprefix('dropout_')}, {who}",
            )  # fmt: skip
    axes.set(xlabel="range, m", ylabel="lost rays, %", xlim=(0, 80), ylim=(0, 20))
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=80)
    pyplot.close(figure)
