"""The page about objects in real boxes: one self-contained HTML file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.fidelity.objects.figures import FIGURES
from urbantwin.fidelity.report_html import html_document

__all__ = ["write_objects_page"]

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1d2733;max-width:1400px;margin:2em auto;
padding:0 1em}table{border-collapse:collapse;width:100%;font-size:13px}
th,td{padding:.3em .5em;text-align:right;border-bottom:1px solid #d5dbe2}
th:first-child,td:first-child{text-align:left}img{width:100%}tr.all td{font-weight:bold;
background:#f2f5f8}dt{font-weight:bold}
.doubt{background:#fff4e5;border-left:4px solid #e8710a;padding:.4em .8em;margin:.4em 0}
"""
_COLUMNS = {
    "boxes": "Boxes",
    "points_ratio": "Points, mended",
    "points_ratio_annotated": "annotated",
    "chamfer_m": "Chamfer m, mended",
    "chamfer_annotated_m": "annotated",
    "chamfer_both_m": "where both return",
    "chamfer_opaque_m": "beside panes",
    "chamfer_again_m": "ours, drawn again",
    "code": "Code %",
    "code_p90": "P90",
    "code_zero": "Code 0 %",
    "lost_opaque": "Lost, opaque %",
    "lost_panes": "panes %",
    "through_panes": "Through panes %",
}


def write_objects_page(report: Mapping[str, Any], picture: Path, path: Path) -> None:
    """Write the page.

    Args:
        report: what ``objects.json`` holds.
        picture: the PNG that is put into it.
        path: the HTML file.
    """
    image = b64encode(picture.read_bytes()).decode()
    said = [*report["problems"], *report["notes"]]
    body = [
        f"<h1>Objects of {escape(report['real'])}</h1>",
        f"<p>{escape(report['in_short'])}</p>",
        *(f'<p class="doubt">{escape(one)}</p>' for one in said),
        "<p>Cells with two numbers: real / ours.</p>",
        _table(report["figures"]),
        f'<img alt="Objects" src="data:image/png;base64,{image}">',
        "<h2>What the figures are</h2><dl>",
        *(
            f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>"
            for name, text in report["definitions"].items()
        ),
        "</dl>",
    ]
    path.write_text(html_document("Objects", body, _STYLE), encoding="utf-8")


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    assert set(_COLUMNS) <= set(FIGURES)
    head = "".join(f"<th>{escape(one)}</th>" for one in ("Class", "m", *_COLUMNS.values()))
    return f"<table><tr>{head}</tr>{''.join(_lines(rows))}</table>"


def _lines(rows: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    last = None
    for row in rows:
        cells = "".join(f"<td>{_cell(row[key])}</td>" for key in _COLUMNS)
        span = f"{row['from_m']:.0f}–{row['to_m']:.0f}"
        kind = ' class="all"' if row["class"] != last else ""
        last = row["class"]
        yield f"<tr{kind}><td>{escape(row['class'])}</td><td>{span}</td>{cells}</tr>"


def _cell(value: Any) -> str:  # noqa: ANN401 - a number, a pair or nothing
    if value is None:
        return "–"
    if isinstance(value, Mapping):
        return f"{value['real']:.3g} / {value['ours']:.3g}"
    return f"{value:.3g}"
