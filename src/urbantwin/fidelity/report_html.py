"""Parts of the HTML pages of reports: one style, tables, pictures inside the page."""

from __future__ import annotations

import hashlib
import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

__all__ = ["html_document", "html_picture", "html_table", "write_html"]

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1d2733;max-width:1240px;margin:2em auto;
padding:0 1em}
h1{font-size:1.7em;margin-bottom:.1em}h2{font-size:1.2em;margin-top:2em}
h3{font-size:1em;margin:1.5em 0 0}
table{border-collapse:collapse;width:100%}th,td{padding:.3em .6em;text-align:right;
border-bottom:1px solid #d5dbe2;vertical-align:top}th:first-child,td:first-child{text-align:left}
td.text,th.text{text-align:left}td small{color:#5a6675}img{width:100%;margin-top:.6em}
tr.head td{font-weight:bold;background:#f2f5f8}ul{padding-left:1.2em}
.lead{font-size:1.25em;line-height:1.4;background:#eef4fd;border-left:4px solid #1769e0;
padding:.6em .9em}
.doubt{background:#fff4e5;border-left:4px solid #e8710a;padding:.4em .8em;margin:.4em 0}
summary{cursor:pointer;font-size:1.2em;font-weight:bold;margin-top:1.4em}
"""


def write_html(path: Path, title: str, parts: Iterable[str]) -> None:
    """Write a page that needs no other file; the same parts give the same bytes."""
    path.write_text(html_document(title, parts, _STYLE), encoding="utf-8")


def html_document(title: str, parts: Iterable[str], style: str) -> str:
    """Return a page whose content security policy allows its own scripts and pictures alone.

    Source: W3C, Content Security Policy Level 3. A script is allowed by its SHA-256.
    """
    body = "\n".join(parts)
    digests = [
        b64encode(hashlib.sha256(script.encode()).digest()).decode()
        for script in re.findall(r"<script>(.*?)</script>", body, re.DOTALL)
    ]
    scripts = " ".join(f"'sha256-{one}'" for one in digests) or "'none'"
    policy = (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {scripts}; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>{body}</body></html>\n"
    )


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, text: bool = False) -> str:
    """Return a table.

    Args:
        head: names of the columns.
        rows: cells as text, in which <small> is kept; a row of one cell is a heading.
        text: of words rather than of numbers.
    """
    kind = ' class="text"' if text else ""
    lines = ["<table><tr>" + "".join(f"<th{kind}>{escape(one)}</th>" for one in head) + "</tr>"]
    for row in rows:
        cells = [_safe(one) for one in row]
        if len(cells) == 1:
            lines.append(f'<tr class="head"><td colspan="{len(head)}">{cells[0]}</td></tr>')
        else:
            lines.append("<tr>" + "".join(f"<td{kind}>{one}</td>" for one in cells) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _safe(text: str) -> str:
    """Escape what is not ours: all but <small>."""
    safe = escape(text, quote=False)
    return safe.replace("&lt;small&gt;", "<small>").replace("&lt;/small&gt;", "</small>")


def html_picture(title: str, path: Path, *, head: bool = True, level: int = 2) -> str:
    """Return a PNG as a part of the page, with its title above it if ``head``."""
    data = b64encode(path.read_bytes()).decode()
    shown = f"<h{level}>{escape(title)}</h{level}>" if head else ""
    return f'{shown}<img alt="{escape(title)}" src="data:image/png;base64,{data}">'
