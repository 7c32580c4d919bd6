"""Pictures of a fusion study: average precision over bit rate, and over impairments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from urbantwin.fidelity.report_style import INK, blank, plain, save

__all__ = ["draw_bitrate", "draw_curves", "draw_failure"]

#: Colour (distinguishable with colour blindness, Okabe and Ito) and marker of each way.
_WAYS = {"early": ("#0072b2", "o"), "middle": ("#d55e00", "D"), "late": ("#009e73", "v")}
_ALONE = "#7b8794"
#: Study and unit -> title of its curve.
_CURVES = {
    ("latency", "s"): "Latency, s",
    ("clock", "s"): "Clocks off by, s (latency 0.2 s)",
    ("pose", "m"): "Place off by, m (standard deviation)",
    ("pose", "deg"): "Heading off by, ° (standard deviation)",
    ("loss", "share"): "Share of packets lost",
    ("nodes", "nodes"): "Nodes, the receiver included",
}

Row = Mapping[str, Any]


def draw_bitrate(rows: Sequence[Row], path: Path) -> bool:
    """Draw mean average precision over bit rate; return whether there were data.

    Args:
        rows: rows of the table.
        path: the PNG.
    """
    mine = [row for row in rows if row["study"] == "bitrate"]
    if not mine:
        return False
    figure = blank(11, 6.4)
    axes = figure.add_axes((0.07, 0.1, 0.9, 0.82))
    plain(axes, "Mean average precision, %, over what all nodes send, kbit/s (log)")
    for way, (colour, mark) in _WAYS.items():
        some = [row for row in mine if row["way"] == way]
        some.sort(key=lambda row: (row["kbit_s"], -row["map"]))
        x, y = [row["kbit_s"] for row in some], [row["map"] for row in some]
        ends = [
            [abs(row["map"] - row[end]) if row[end] is not None else 0.0 for row in some]
            for end in ("map_low", "map_high")
        ]
        axes.errorbar(x, y, ends, color=colour, marker=mark, ms=6, ls="", elinewidth=0.6,
                      alpha=0.9, label=way)  # fmt: skip
        # Points that are better than all with fewer bits.
        front = [k for k in range(len(some)) if y[k] > max(y[:k], default=-1.0)]
        axes.plot([x[k] for k in front], [y[k] for k in front], color=colour, lw=1.6, alpha=0.6)
    alone = next(row["map"] for row in mine if row["way"] == "alone")
    axes.axhline(alone, color=_ALONE, lw=1.2, ls="--", label="receiver alone")
    axes.set_xscale("log")
    axes.legend(fontsize=8, frameon=False, loc="lower right")
    axes.set_xlabel("kbit/s, headers included; bars: 95 % intervals; lines: best for the bits",
                    fontsize=8, color=INK)  # fmt: skip
    save(figure, path)
    return True


def draw_curves(rows: Sequence[Row], path: Path) -> bool:
    """Draw the curves of all studies that sweep a value; return whether there were any."""
    curves = {
        title: [row for row in rows if (row["study"], row["unit"]) == swept]
        for swept, title in _CURVES.items()
    }
    shown = {title: some for title, some in curves.items() if some}
    if not shown:
        return False
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    figure = blank(5 * across, 3.9 * down)
    alone = next(row["map"] for row in rows if row["way"] == "alone")
    for number, (title, some) in enumerate(shown.items()):
        axes = figure.add_subplot(down, across, number + 1)
        plain(axes, title)
        _draw_curve(axes, some)
        axes.axhline(alone, color=_ALONE, ls=":", lw=1.4, label="alone")
        axes.set_ylabel("mean average precision, %", fontsize=8, color=INK)
        axes.set_ylim(bottom=0)
        if some[0]["study"] == "nodes":
            axes.set_xticks(sorted({int(row["value"]) for row in some}))
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=7, fontsize=9, frameon=False)
    figure.subplots_adjust(0.16 / across, 0.14 / down, 0.985, 1 - 0.19 / down, 0.2, 0.28)
    save(figure, path)
    return True


def _draw_curve(axes: Axes, rows: Sequence[Row]) -> None:
    for aligned, style, words in ((False, "-", ""), (True, "--", ", moved by its stamp")):
        for way, (colour, _) in _WAYS.items():
            mine = [row for row in rows if row["way"] == way and row["aligned"] == aligned]
            if not mine:
                continue
            value, mean = [row["value"] for row in mine], [row["map"] for row in mine]
            axes.plot(value, mean, style, marker="o", ms=3.5, color=colour, label=way + words)
            if not aligned and all(row["map_low"] is not None for row in mine):
                low, high = ([row[end] for row in mine] for end in ("map_low", "map_high"))
                axes.fill_between(value, low, high, color=colour, alpha=0.1, lw=0)


def draw_failure(rows: Sequence[Row], path: Path) -> bool:
    """Draw mean average precision over time, with and without a node that falls silent."""
    if not rows:
        return False
    figure = blank(11, 4.2)
    axes = figure.add_axes((0.06, 0.13, 0.92, 0.76))
    plain(axes, "Mean average precision, %, over time, s; dashed: one node falls silent")
    for way, colour in {"alone": _ALONE, **{k: one[0] for k, one in _WAYS.items()}}.items():
        for silent, style in ((False, "-"), (True, "--")):
            mine = [
                row for row in rows
                if row["way"] == way and (row["silent_from_s"] is not None) == silent
                and row["map"] is not None
            ]  # fmt: skip
            if mine:
                middle = [(row["from_s"] + row["to_s"]) / 2 for row in mine]
                axes.plot(middle, [row["map"] for row in mine], style, marker="o", ms=4,
                          color=colour, label=None if silent else way)  # fmt: skip
    for silent_from in {row["silent_from_s"] for row in rows} - {None}:
        axes.axvline(silent_from, color=INK, lw=1, ls=":")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8, frameon=False, ncols=4)
    save(figure, path)
    return True
