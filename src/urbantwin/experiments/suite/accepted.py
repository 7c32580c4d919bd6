"""Accepted results of a suite, and the differences from them as a table (Markdown)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact import read_json, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.experiments.suite.motion_print import MotionPrint

__all__ = ["Accepted", "table_of"]

#: Maximum number of actors and values of events named for each case in the table.
_NAMED = 10


@dataclass(frozen=True)
class Accepted:
    """The accepted results of a suite.

    Attributes:
        folder: their folder.
        manifest: ``suite.json``: versions, the twin's hash and, by their keys, the cases.
    """

    folder: Path
    manifest: dict[str, Any]

    @classmethod
    def open(cls, folder: Path) -> Accepted:
        """Open a folder; a folder that does not exist has no cases.

        Raises:
            InputError: the file is not a suite.
        """
        file = folder / "suite.json"
        if not file.is_file():
            return cls(folder, {"cases": {}})
        manifest = read_json(file, kind="suite")
        if manifest.get("kind") != "suite" or not isinstance(manifest.get("cases"), dict):
            raise InputError("is not what a suite accepted", file=file, expected='"kind": "suite"')
        return cls(folder, manifest)

    def of(self, key: str) -> MotionPrint | None:
        """Return the accepted result of a case; ``None`` if there is none.

        Raises:
            InputError: it is damaged.
        """
        told = self.manifest["cases"].get(key)
        return None if told is None else MotionPrint.read(self.folder / f"{key}.parquet", told)

    def differs(self, made_with: Mapping[str, Any]) -> list[str]:
        """Return the differences of program, SUMO and twin from those of the accepted results."""
        before = self.manifest.get("made_with")
        if before is None:
            return []
        return [
            f"{name}: {before.get(name)} before, {value} now"
            for name, value in made_with.items()
            if before.get(name) != value
        ]

    @classmethod
    def write(
        cls, folder: Path, prints: Mapping[str, MotionPrint], made_with: Mapping[str, Any]
    ) -> Accepted:
        """Store cases and replace what was accepted before."""
        manifest = {
            "kind": "suite",
            "version": 1,
            "urbantwin": __version__,
            "made_with": dict(made_with),
            "cases": {key: one.told for key, one in prints.items()},
        }
        with replaced_folder(folder, kind="suite") as scratch:
            for key, one in prints.items():
                one.write(scratch / f"{key}.parquet")
            write_json(scratch / "suite.json", manifest)
        return cls(folder, manifest)


def table_of(rows: Sequence[dict[str, Any]], makers: Sequence[str]) -> str:
    """Return a page: a table of the cases, and the differences of each changed case.

    Args:
        rows: rows of the cases: ``case``, ``state``, and the result of `changes_between` or
            ``why``.
        makers: differences of program, SUMO and twin.
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
