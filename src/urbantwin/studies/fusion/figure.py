"""The pictures of a study: average precision over bits, and over what goes wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from urbantwin.fidelity.report_style import INK, blank, plain, save
from urbantwin.studies.fusion.setting import STUDIES

__all__ = ["WAYS", "draw_bitrate", "draw_curves", "draw_failure"]

#: Colours apart for people who see no red or no green (Okabe and Ito).
WAYS = {"early": "#0072b2", "middle": "#d55e00", "late": "#009e73", "alone": "#7b8794"}
_MARKS = {"early": "o", "middle": "D", "late": "v"}
_TITLES = {
    "latency": "Latency, s",
    "clock": "Clocks off by, s (latency 0.2 s)",
    "pose m": "Place off by, m (standard deviation)",
    "pose deg": "Heading off by, ° (standard deviation)",
    "loss": "Share of packets lost",
    "nodes": "Nodes, the receiver included",
}

Row = Mapping[str, Any]


def draw_bitrate(rows: Sequence[Row], path: Path) -> bool:
    """Draw mean average precision over bits a second; return whether there was anything to draw.

    Args:
        rows: of the table.
        path: the PNG.
    """
    mine = [one for one in rows if one["study"] == "bitrate"]
    if not mine:
        return False
    figure = blank(11, 6.4)
    axes = figure.add_axes((0.07, 0.1, 0.9, 0.82))
    plain(axes, "Mean average precision, %, over what all nodes send, kbit/s (log)")
    for row in mine:
        if row["way"] == "alone":
            axes.axhline(row["map"], color=WAYS["alone"], lw=1.2, ls="--")
            axes.annotate("receiver alone", (0.005, row["map"]), fontsize=8, color=WAYS["alone"],
                          xycoords=("axes fraction", "data"), va="bottom")  # fmt: skip
            continue
        low = row["map"] if row["map_low"] is None else row["map_low"]
        high = row["map"] if row["map_high"] is None else row["map_high"]
        off = [[max(row["map"] - low, 0)], [max(high - row["map"], 0)]]
        axes.errorbar(row["kbit_s"], row["map"], off, color=WAYS[row["way"]], ms=6,
                      marker=_MARKS[row["way"]],
                      lw=0.6, ecolor=WAYS[row["way"]], alpha=0.9)  # fmt: skip
    for way in ("early", "middle", "late"):
        _front(axes, [one for one in mine if one["way"] == way], way)
    axes.set_xscale("log")
    for way, mark in _MARKS.items():
        axes.plot([], [], color=WAYS[way], marker=mark, ls="", label=way)
    axes.legend(fontsize=8, frameon=False, loc="lower right")
    axes.set_xlabel("kbit/s, headers included; bars: 95 % intervals; lines: best for the bits",
                    fontsize=8, color=INK)  # fmt: skip
    save(figure, path)
    return True


def _front(axes: Axes, rows: Sequence[Row], way: str) -> None:
    """Draw the points that none with fewer bits is as good as."""
    best, front = -1.0, []
    for row in sorted(rows, key=lambda one: (one["kbit_s"], -one["map"])):
        if row["map"] > best:
            best = row["map"]
            front.append(row)
    axes.plot([one["kbit_s"] for one in front], [one["map"] for one in front],
              color=WAYS[way], lw=1.6, alpha=0.6)  # fmt: skip


def draw_curves(rows: Sequence[Row], path: Path) -> bool:
    """Draw the curves of all studies that sweep a value; return whether there were any."""
    curves: dict[str, list[Row]] = {}
    for study in STUDIES:
        for row in rows:
            if row["study"] == study and (row["unit"] is not None or row["way"] == "alone"):
                name = f"{study} {row['unit']}" if study == "pose" else study
                curves.setdefault(name, []).append(row)
    shown = [name for name in _TITLES if curves.get(name)]
    if not shown:
        return False
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    figure = blank(5 * across, 3.9 * down)
    for number, name in enumerate(shown):
        axes = figure.add_subplot(down, across, number + 1)
        _curve(axes, name, curves[name], [row for row in rows if row["way"] == "alone"])
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=7, fontsize=9, frameon=False)
    figure.subplots_adjust(0.16 / across, 0.14 / down, 0.985, 1 - 0.19 / down, 0.2, 0.28)
    save(figure, path)
    return True


def _curve(axes: Axes, name: str, rows: Sequence[Row], alone: Sequence[Row]) -> None:
    plain(axes, _TITLES[name])
    axes.set_ylabel("mean average precision, %", fontsize=8, color=INK)
    for aligned in (False, True):
        for way in ("early", "middle", "late"):
            mine = [row for row in rows if row["way"] == way and row["aligned"] == aligned]
            mine.sort(key=lambda row: row["value"])
            if not mine:
                continue
            value = [row["value"] for row in mine]
            style = "--" if aligned else "-"
            words = f"{way}, moved by its stamp" if aligned else way
            axes.plot(value, [row["map"] for row in mine], style, marker="o", ms=3.5,
                      color=WAYS[way], label=words)  # fmt: skip
            if not aligned and all(row["map_low"] is not None for row in mine):
                axes.fill_between(value, [row["map_low"] for row in mine],
                                  [row["map_high"] for row in mine], color=WAYS[way], alpha=0.1,
                                  lw=0)  # fmt: skip
    if alone:
        axes.axhline(alone[0]["map"], color=WAYS["alone"], ls=":", lw=1.4, label="alone")
    if name == "nodes":
        axes.set_xticks(sorted({int(row["value"]) for row in rows if row["value"] is not None}))
    axes.set_ylim(bottom=0)


def draw_failure(rows: Sequence[Row], path: Path) -> bool:
    """Draw mean average precision over time, with and without a node that falls silent."""
    if not rows:
        return False
    figure = blank(11, 4.2)
    axes = figure.add_axes((0.06, 0.13, 0.92, 0.76))
    plain(axes, "Mean average precision, %, over time, s; dashed: one node falls silent")
    silent = [row["silent_from_s"] for row in rows if row["silent_from_s"] is not None]
    for way in ("alone", "early", "middle", "late"):
        for dies in (False, True):
            mine = [
                row for row in rows
                if row["way"] == way and (row["silent_from_s"] is not None) == dies
                and row["map"] is not None
            ]  # fmt: skip
            if mine:
                middle = [(row["from_s"] + row["to_s"]) / 2 for row in mine]
                style, words = ("--", None) if dies else ("-", way)
                axes.plot(middle, [row["map"] for row in mine], style, marker="o", ms=4,
                          color=WAYS[way], label=words)  # fmt: skip
    if silent:
        axes.axvline(silent[0], color=INK, lw=1, ls=":")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8, frameon=False, ncols=4)
    save(figure, path)
    return True
