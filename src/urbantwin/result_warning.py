"""Warnings about a result: problem, reason and remedy.

Every stage stores its warnings in its manifest under ``warnings``; `urbantwin.interface` prints
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from urbantwin.errors import readable

__all__ = ["ResultWarning", "rows_of", "warnings_of"]


@dataclass(frozen=True)
class ResultWarning:
    """A problem of a result.

    ``str(warning)`` is one line: ``ABOUT: PROBLEM: REASON; REMEDY``.

    Attributes:
        about: subject in a word or two: ``crossings``, ``sensor pole``.
        problem: the problem, with numbers: ``5 of 11 mapped ones are in the twin``.
        reason: reason, if known.
        remedy: what the user can do.
    """

    about: str
    problem: str
    reason: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        """Return the warning as one line."""
        text = f"{self.about}: {self.problem}"
        text += f": {self.reason}" if self.reason else ""
        return readable(text + (f"; {self.remedy}" if self.remedy else ""), 600)


def rows_of(warnings: Iterable[ResultWarning]) -> list[dict[str, str]]:
    """Return warnings as rows of a manifest, without empty fields."""
    return [{key: text for key, text in asdict(one).items() if text} for one in warnings]


def warnings_of(manifest: Mapping[str, Any]) -> tuple[ResultWarning, ...]:
    """Return the warnings in a manifest; malformed rows are ignored."""
    rows = manifest.get("warnings")
    names = ResultWarning.__dataclass_fields__
    return tuple(
        ResultWarning(**{name: str(row.get(name, "")) for name in names})
        for row in (rows if isinstance(rows, list) else ())
        if isinstance(row, dict) and "problem" in row
    )
