"""Draw the bar charts of docs/results/ from the tables of these pages.

``python docs/site_build/charts.py`` writes them into ``docs/assets/``; a test fails when that is
due.
"""

import re
from dataclasses import dataclass
from html import escape
from pathlib import Path

__all__ = ["CHARTS", "Chart", "draw"]

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
ASSETS = ROOT / "docs" / "assets"
WIDTH, LABEL, ROW = 820, 330, 22
#: Colours of the columns, readable on white and by colour-blind people (Okabe and Ito 2008).
COLOURS = ("#0072b2", "#e69f00", "#999999")


@dataclass(frozen=True)
class Chart:
    """A chart of columns of a table.

    Attributes:
        name: of the SVG file.
        page: with the table.
        heading: of the part of the page whose first table is drawn; empty for the page's first.
        columns: numbers of the columns, from 0; the first number in a cell is drawn.
        title: of the chart, with the unit.
    """

    name: str
    page: str
    heading: str
    columns: tuple[int, ...]
    title: str


CHARTS = (
    Chart("results_twins", "twins.md", "Hannover", (1, 2, 4),
          "Hannover, frames 13 to 24: JS divergences and distances (m)"),
    Chart("results_detectors", "detectors.md", "", (2, 3),
          "Average precision on real frames, per cent"),
    Chart("results_bodies", "sensors.md", "Shapes of bodies", (2, 3),
          "Chamfer distance of bodies in real boxes, cm"),
    Chart("results_traffic", "places.md", "Traffic over an hour", (2,),
          "Traffic driven of the request, over an hour"),
)  # fmt: skip


def table_of(chart: Chart) -> tuple[list[str], list[list[str]]]:
    """Return the heads and the rows of a chart's table."""
    text = (RESULTS / chart.page).read_text(encoding="utf-8")
    if chart.heading:
        text = re.split(rf"^## {chart.heading}.*$", text, maxsplit=1, flags=re.MULTILINE)[1]
    lines = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)
    assert lines is not None, chart.page
    cells = [
        [cell.strip() for cell in line.strip("|\n").split("|")] for line in lines[0].splitlines()
    ]
    return cells[0], cells[2:]


def draw(chart: Chart) -> str:
    """Return a chart as SVG: a group of bars for each row of its table."""
    heads, rows = table_of(chart)
    drawn = [row for row in rows if all(_number(row[k]) is not None for k in chart.columns)]
    greatest = max(_number(row[k]) or 0.0 for row in drawn for k in chart.columns)
    scale = (WIDTH - LABEL - 90) / greatest
    step = ROW * len(chart.columns) - (len(chart.columns) - 1) * 6 + 10
    parts = [f'<text x="12" y="24" class="t">{escape(chart.title)}</text>']
    for number, column in enumerate(chart.columns):
        x = 12 + number * 240
        parts.append(f'<rect x="{x}" y="38" width="12" height="12" fill="{COLOURS[number]}"/>')
        parts.append(f'<text x="{x + 18}" y="49">{escape(heads[column])}</text>')
    for index, row in enumerate(drawn):
        y = 68 + index * step
        parts.append(
            f'<text x="{LABEL - 10}" y="{y + step / 2 + 1:g}" class="r">{escape(row[0])}</text>'
        )
        for number, column in enumerate(chart.columns):
            value = _number(row[column])
            if value is None:
                continue
            top, length = y + number * (ROW - 6), value * scale
            colour = COLOURS[number]
            parts.append(
                f'<rect x="{LABEL}" y="{top}" width="{length:.1f}" height="13" fill="{colour}"/>'
                f'<text x="{LABEL + length + 6:.1f}" y="{top + 11}">{escape(row[column])}</text>'
            )
    height = 74 + len(drawn) * step
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        'font-family="sans-serif" font-size="12" fill="#222">\n'
        "<style>.t{font-size:15px;font-weight:600}.r{text-anchor:end}</style>\n"
        f'<rect width="{WIDTH}" height="{height}" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def _number(cell: str) -> float | None:
    found = re.match(r"[\d,]+(?:\.\d+)?", cell)
    return None if found is None else float(found[0].replace(",", ""))


if __name__ == "__main__":
    for one in CHARTS:
        (ASSETS / f"{one.name}.svg").write_text(draw(one), encoding="utf-8")
