"""What became different in a suite, as a table that people read (Markdown)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["table_of"]

#: So many actors and values of events are named of each case.
_NAMED = 10


def table_of(rows: Sequence[dict[str, Any]], makers: Sequence[str]) -> str:
    """Return a page: a table of the cases, and what differs in each that is not the same.

    Args:
        rows: of the cases: ``case``, ``state``, and what `changes_between` found or ``why``.
        makers: in what the makers differ.
    """
    lines = ["# What became different", ""]
    lines += [f"- {one}" for one in makers]
    lines += ["", "| case | state | from | who first | actors | values of events |"]
    lines += ["|---|---|---|---|---|---|"]
    for row in rows:
        first = row.get("first")
        who = f"{first['class']} {first['track']} {first['change']}" if first else ""
        from_s = f"{row['from_s']:g} s" if "from_s" in row else ""
        counts = " | ".join(str(len(row.get(name, ())) or "") for name in ("actors", "events"))
        lines.append(f"| {row['case']} | {row['state']} | {from_s} | {who} | {counts} |")
    for row in rows:
        if row["state"] in ("same", "new"):
            continue
        lines += ["", f"## {row['case']}", ""]
        if "why" in row:
            lines.append(str(row["why"]))
        for one in row.get("events", ())[:_NAMED]:
            lines.append(
                f"- event {one['number']}, {one['event']}: {one['field']} was {one['before']}, "
                f"is {one['after']}"
            )
        for one in row.get("actors", ())[:_NAMED]:
            far = f", by {one['most_m']:g} m at most" if "most_m" in one else ""
            lines.append(
                f"- {one['class']} {one['track']}: {one['change']} from {one['from_s']:g} s{far}"
            )
        more = len(row.get("actors", ())) - _NAMED
        if more > 0:
            lines.append(f"- and {more} more actors")
        lines += [f"- {name} differ" for name in row.get("also", ())]
    return "\n".join(lines) + "\n"
