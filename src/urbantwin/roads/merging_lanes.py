"""Merging lanes of one street, with alternating priority (zipper).

By default one lane has priority over the other in SUMO. Drivers avoid the yielding lane early, and
on a busy street it stays empty however long the queue on the other lane is.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from lxml import etree

from urbantwin.roads.signals.controlled_links import outgoing_of_lanes, rows_of_junction

__all__ = ["zip_merging_lanes"]

#: SUMO's state letter for zipper merging.
ZIPPER = "Z"


def zip_merging_lanes(net: Path) -> int:
    """Set zipper merging for lanes of one street that become one; return the number of places.

    Places with signals, or where the lanes also yield to other traffic, stay unchanged.

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
            continue  # No conflicts there.
        merging: dict[tuple[str, ...], list[int]] = defaultdict(list)
        for row, item in enumerate(rows):
            if item.get("tl") is None and edges[item.get("to")].get("function") is None:
                merging[item.get("from"), item.get("to"), item.get("toLane")].append(row)
        for together in merging.values():
            foreign = (_marked(table[row].get("response")) - set(together) for row in together)
            if len(together) < 2 or any(foreign):
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
    """Return the rows set in a bit string, whose last letter is row 0."""
    return {row for row, bit in enumerate(reversed(bits)) if bit == "1"}
