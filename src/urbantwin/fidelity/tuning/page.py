"""The report of a fit as one self-contained HTML file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.artefact import read_json
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.report_html import html_document
from urbantwin.fidelity.tuning.figure import draw_fit
from urbantwin.fidelity.tuning.fit import RigFit
from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.simulated import SimulatedFrames

__all__ = ["write_report"]

#: Frames of each part that the distributions are of.
_DRAWN = 4
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1d2733;max-width:1240px;margin:2em auto;
padding:0 1em}table{border-collapse:collapse;width:100%}
th,td{padding:.3em .6em;text-align:right;border-bottom:1px solid #d5dbe2}
th:first-child,td:first-child{text-align:left}img{width:100%}
.doubt{background:#fff4e5;border-left:4px solid #e8710a;padding:.4em .8em;margin:.4em 0}
"""


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
        fit: what was found.
        judged: what ``held_out.json`` holds.
        training: the frames that were fitted to.
        held: the frames held out.
        sides: of ``start`` and ``tuned``, the frames that the rig records.
        scale: full scale of real intensity.
    """
    few = range(_DRAWN)
    made = {name: [side.frame(k) for k in few] for name, side in sides.items()}
    parts = {
        part: {"real": looks.clouds[:: max(1, looks.frames // _DRAWN)][:_DRAWN], **made}
        for part, looks in (("training", training), ("held out", held))
    }
    draw_fit(fit, parts, None if training.intensity is None else scale, out / "report.png")
    written = read_json(out / "tuning.json", kind="tuning")
    (out / "report.html").write_text(_page(written, judged, out / "report.png"), encoding="utf-8")


def _page(written: dict[str, Any], judged: dict[str, Any], picture: Path) -> str:
    image = b64encode(picture.read_bytes()).decode()
    said = [*judged["warnings"], *written["problems"], *judged["problems"]]
    split = written["split"]
    spans = "; ".join(
        f"{name.replace('_', ' ')} {span[0]} to {span[1]}" for name, span in split.items() if span
    )
    body = [
        f"<h1>Tuning to {escape(written['real'])}</h1><p>Frames: {spans}.</p>",
        *(f'<p class="doubt">{escape(one)}</p>' for one in said),
        "<h2>What was fitted</h2>",
        _table(
            ("", "Before", "Fitted", "Standard error", "Bounds", "State"),
            (_knob(name, one) for name, one in written["knobs"].items()),
        ),
        "<h2>On the frames held out</h2>",
        _table(
            ("Group", "Loss before", "Loss after", "Verdict"),
            (
                (name, f"{one['start']:.4g}", f"{one['tuned']:.4g}", one["verdict"])
                for name, one in judged["groups"].items()
            ),
        ),
        f"<p>Measures of <code>compare</code>, means of {judged['measured_frames']} frames.</p>",
        _table(
            ("Measure", "Before", "After", "Real against real"),
            (
                (
                    MEASURES[name].title
                    + (f", {MEASURES[name].unit}" if MEASURES[name].unit else ""),
                    *(_number(one[side]) for side in ("start", "tuned", "real")),
                )
                for name, one in judged["measures"].items()
                if name in MEASURES
            ),
        ),
        f'<h2>Pictures</h2><img alt="The fit" src="data:image/png;base64,{image}">',
        "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in written["notes"]) + "</ul>",
    ]
    return html_document("Tuning", body, _STYLE)


def _knob(name: str, one: dict[str, Any]) -> Sequence[str]:
    error = one.get("standard_error")
    known = f"± {error:.2g}" if error is not None else "unknown"
    times = one.get("standard_error_factor")
    if times is not None:
        known = f"×/÷ {times:.3g}"
    unit = one["unit"] if one["unit"] in ("m", "deg") else ""
    low, high = one["bounds"]
    return (
        name,
        f"{one['start']:.4g} {unit}",
        f"{one['value']:.4g} {unit}",
        known,
        f"{low:.3g} to {high:.3g}",
        one["state"],
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(one)}</th>" for one in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{top}</tr>{body}</table>"
