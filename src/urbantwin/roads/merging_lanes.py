"""Lanes of one street that become one: by turns, as with a zipper.

Without that, one lane has priority over the other in SUMO; those who drive there are told so well
before, and where the street is full, nobody takes the lane that gives way, however long the queue
on the other is.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from lxml import etree

from urbantwin.roads.signals.controlled_links import outgoing_of_lanes, rows_of_junction

__all__ = ["zip_merging_lanes"]

#: SUMO's letter for it.
ZIPPER = "Z"


def zip_merging_lanes(net: Path) -> int:
    """Let lanes of one street that become one take turns; return how many such places there are.

    Where they also give way to others, or have signals, all stays as it is.

    Args:
        net: the ``.net.xml``, rewritten.
    """
    tree = etree.parse(net)
    root = tree.getroot()
    edges = {str(edge.get("id")): edge for edge in root.iter("edge")}
    outgoing = outgoing_of_lanes(root)
    zipped = 0
    for junction in root.iterfind("junction"):
        rows = rows_of_junction(junction, outgoing, edges)
        table = {int(item.get("index")): item for item in junction.iterfind("request")}
        if len(table) != len(rows):
            continue  # Nobody meets anybody there.
        merging: dict[tuple[str, ...], list[int]] = defaultdict(list)
        for row, item in enumerate(rows):
            if item.get("tl") is None and edges[item.get("to")].get("function") is None:
                merging[item.get("from"), item.get("to"), item.get("toLane")].append(row)
        for together in merging.values():
            others = (_marked(table[row].get("response")) - set(together) for row in together)
            if len(together) < 2 or any(others):
                continue
            zipped += 1
            for row in together:
                rows[row].set("state", ZIPPER)
                for key in ("response", "foes"):
                    marked = _marked(table[row].get(key)) | set(together) - {row}
                    letters = ("1" if k in marked else "0" for k in reversed(range(len(table))))
                    table[row].set(key, "".join(letters))
    if zipped:
        tree.write(str(net), xml_declaration=True, encoding="UTF-8")
    return zipped


def _marked(bits: str) -> set[int]:
    """Return the rows that a row of the table names: the last letter stands for the first."""
    return {row for row, bit in enumerate(reversed(bits)) if bit == "1"}
