"""Escaping of untrusted texts in Markdown, against broken tables and HTML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import quote

from urbantwin.errors import readable

__all__ = ["code", "escaped", "front_matter", "picture"]

#: Characters with an inline meaning in CommonMark (6.1) and in GitHub's additions: tables,
#: strike-out, mentions (@), issue references (#) and mathematics ($). Without square brackets,
#: round brackets and exclamation marks have no meaning.
_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~$@&])")
#: Characters that begin a list, a heading or a rule at the start of a line.
_OPENING = re.compile(r"^(\d+)([.)])(?=\s|$)|^([-+=:])")
#: Addresses that renderers turn into links.
_LINK = re.compile(r"(?i)\b(https?|ftp)(:)(?=//)|\b(www)(\.)")
#: Most characters of a text; longer texts are file contents, not names.
_LONGEST = 500


def escaped(text: object) -> str:
    """Return a text as literal Markdown: one line without mark-up, HTML or links."""
    line = _SPECIAL.sub(r"\\\1", readable(str(text), _LONGEST))
    line = _LINK.sub(lambda one: f"{one[1] or one[3]}\\{one[2] or one[4]}", line)
    return _OPENING.sub(lambda one: f"{one[1]}\\{one[2]}" if one[1] else f"\\{one[3]}", line)


def code(text: object) -> str:
    """Return a text as inline code, also within a table."""
    line = readable(str(text), _LONGEST)
    if "|" in line:  # a table splits at a bar even in code
        return f"<code>{escaped(line)}</code>"
    ticks = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    blank = " " if line[:1] == "`" or line[-1:] == "`" else ""
    return f"{ticks}{blank}{line}{blank}{ticks}" if line else ""


def picture(path: str, shows: str) -> str:
    """Return a picture of this folder, with an alternative text."""
    return f"![{escaped(shows)}]({quote(path)})"


def front_matter(fields: Mapping[str, object]) -> str:
    """Return YAML front matter, as dataset hubs read it in a card."""
    import yaml

    text = yaml.safe_dump(dict(fields), sort_keys=False, allow_unicode=True, width=1000)
    return f"---\n{text}---"
