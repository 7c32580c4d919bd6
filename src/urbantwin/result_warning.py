"""Warnings about a result: what is wrong with it though it was made, why, and what to do.

Every stage keeps its own in its manifest, under ``warnings``; `urbantwin.interface` tells them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from urbantwin.errors import readable

__all__ = ["ResultWarning", "rows_of", "warnings_of"]


@dataclass(frozen=True)
class ResultWarning:
    """One thing that is wrong with a result.

    ``str(warning)`` is one line: ``ABOUT: PROBLEM: REASON; REMEDY``.

    Attributes:
        about: what it is about, in a word or two: ``crossings``, ``sensor pole``.
        problem: what is wrong, with its numbers: ``5 of 11 mapped ones are in the twin``.
        reason: why, where it is known.
        remedy: what a person can do.
    """

    about: str
    problem: str
    reason: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        """Return the one line that a person reads."""
        text = f"{self.about}: {self.problem}"
        text += f": {self.reason}" if self.reason else ""
        return readable(text + (f"; {self.remedy}" if self.remedy else ""), 600)


def rows_of(warnings: Iterable[ResultWarning]) -> list[dict[str, str]]:
    """Return warnings as a manifest keeps them: what is said, in the order of the fields."""
    return [{key: text for key, text in asdict(one).items() if text} for one in warnings]


def warnings_of(manifest: Mapping[str, Any]) -> tuple[ResultWarning, ...]:
    """Return the warnings that a manifest keeps; what is none of ours is left alone."""
    rows = manifest.get("warnings")
    names = ResultWarning.__dataclass_fields__
    return tuple(
        ResultWarning(**{name: str(row.get(name, "")) for name in names})
        for row in (rows if isinstance(rows, list) else ())
        if isinstance(row, dict) and "problem" in row
    )
