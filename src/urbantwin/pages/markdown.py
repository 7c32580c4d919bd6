"""Markdown in which the texts of strangers are text: they break no table and are no HTML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import quote

from urbantwin.errors import readable

__all__ = ["code", "escaped", "front_matter", "picture"]

#: What CommonMark (6.1) gives a meaning within a line, and GitHub's additions: tables, strike-out,
#: mentions (@), references to issues (#) and mathematics ($). Without square brackets round ones
#: mean nothing, and neither does an exclamation mark.
_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~$@&])")
#: What begins a list, a heading or a rule at the start of a line.
_OPENING = re.compile(r"^(\d+)([.)])(?=\s|$)|^([-+=:])")
#: An address that a reader would make a link of without being told.
_LINK = re.compile(r"(?i)\b(https?|ftp)(:)(?=//)|\b(www)(\.)")
#: Most characters of one text: what is longer is a file's content, not a name.
_LONGEST = 500


def escaped(text: object) -> str:
    """Return a text as Markdown that shows it as it is: one line, no mark-up, no HTML, no links."""
    line = _SPECIAL.sub(r"\\\1", readable(str(text), _LONGEST))
    line = _LINK.sub(lambda one: f"{one[1] or one[3]}\\{one[2] or one[4]}", line)
    return _OPENING.sub(lambda one: f"{one[1]}\\{one[2]}" if one[1] else f"\\{one[3]}", line)


def code(text: object) -> str:
    """Return a text as code within a line, also of a table."""
    line = readable(str(text), _LONGEST)
    if "|" in line:  # a table splits at a bar even in code
        return f"<code>{escaped(line)}</code>"
    ticks = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    blank = " " if line[:1] == "`" or line[-1:] == "`" else ""
    return f"{ticks}{blank}{line}{blank}{ticks}" if line else ""


def picture(path: str, shows: str) -> str:
    """Return a picture of this folder, and what it shows for whom does not see it."""
    return f"![{escaped(shows)}]({quote(path)})"


def front_matter(fields: Mapping[str, object]) -> str:
    """Return YAML between two rules, as hubs of data sets read it at the top of a card."""
    import yaml

    text = yaml.safe_dump(dict(fields), sort_keys=False, allow_unicode=True, width=1000)
    return f"---\n{text}---"
