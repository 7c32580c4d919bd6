"""What in a text, and under which names, may say something of a person, a machine or a moment."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

__all__ = ["in_text", "in_value"]

#: Folders that absolute paths begin with, on Linux, on macOS and in containers.
_ROOTS = (
    "home|Users|root|tmp|var|mnt|media|opt|usr|srv|data|etc|private|Volumes|work|workspace|"
    "workspaces|scratch|nfs|app|build|builds|code|run|storage|content|kaggle|gpfs|lustre|afs|"
    "shared|share|local|cygdrive|export|net|lhome|u|users|datasets"
)
_END = r"[^\s\"'<>|;,)\]}]"
#: What is found by letters that begin it, as that is fast -> what has to stand before these, up to
#: them, for it to be that.
_RULES: tuple[tuple[str, re.Pattern[str], re.Pattern[str]], ...] = (
    (
        "absolute path",
        re.compile(rf"/(?:{_ROOTS})/{_END}+"),
        re.compile(r"(?<![\w.\-/~<])$"),
    ),
    ("absolute path", re.compile(rf"file:///?{_END}+"), re.compile("$")),
    (
        "absolute path",
        re.compile(rf":(?:\\{{1,2}}|/(?!/)){_END}+"),
        re.compile(r"(?<![A-Za-z0-9])[A-Za-z]$"),
    ),
    ("absolute path", re.compile(rf"\\\\[\w.\-]+\\{_END}+"), re.compile(r"(?<![\\\w])$")),
    ("absolute path", re.compile(rf"~[\w\-]*/[\w.]{_END}*"), re.compile(r"(?<![\w/.])$")),
    (
        "e-mail address",
        re.compile(r"@(?!\d+x\.)[A-Za-z0-9\-]+(?:\.[A-Za-z0-9\-]+)*\.[A-Za-z]{2,}\b"),
        re.compile(r"[\w.+\-]+$"),
    ),
    (
        "time stamp",
        re.compile(
            # The day on which Unix's clock begins is nobody's: writers of FBX put it there.
            r"(?!1970-01-01)(?:19|20)\d\d([-:/.])(?:0[1-9]|1[0-2])\1(?:0[1-9]|[12]\d|3[01])[T _]"
            # Midnight is a date: formats that ask for a moment have it from who has none.
            r"(?!00[:\-]00(?![:\-](?!00)\d))(?:[01]\d|2[0-3])[:\-][0-5]\d|"
            r"(?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])[T_\-](?:[01]\d|2[0-3])"
            r"[0-5]\d[0-5]\d(?!\d)"
        ),
        re.compile(r"(?<!\d)$"),
    ),
    (
        "time stamp",
        re.compile(
            r"(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun),? +(?:\d{1,2} )?(?:Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|"
            r"Sep|Oct|Nov|Dec)(?: +\d{1,2})?(?: \d{4})? \d\d:\d\d"
        ),
        re.compile(r"(?<!\w)$"),
    ),
    (
        "name of a person",
        # Attributes of XML: OpenStreetMap's mappers, and who made a document.
        re.compile(r"""=\s*(?:"(?!urbantwin|UrbanTwin)[^"]+"|'(?!urbantwin|UrbanTwin)[^']+')"""),
        re.compile(
            r"(?<![\w:])(?i:user|uid|username|changeset|author|creator|owner|hostname|annotator)\s*$"
        ),
    ),
)
#: So many letters before what is found are looked at.
_BEFORE = 80
#: Names of fields that hold people, their machines, vehicles or numbers.
_PEOPLE = frozenset(
    "user username userid uid author authors creator createdby modifiedby owner annotator "
    "annotatedby hostname host hostcomputer computer computername email mail phone telephone "
    "plate licenceplate licenseplate numberplate registrationplate vin drivername artist "
    "changeset login account homedir workdir cwd".split()
)
_TIME = re.compile(
    r"(?i)(time|stamp|clock|epoch|date|begin|start|stop|utc|gps|created|modified|captured)|"
    r"(^|_)t$|_(s|ms|us|ns)$"
)
#: Seconds since 1970 of 1995 and of 2040; times of recordings come as these, or as 1000, 10^6 or
#: 10^9 times as many.
_FIRST_S, _LAST_S = 788_918_400.0, 2_208_988_800.0
#: Most characters that are shown of what was found.
_SHOWN = 120


def in_text(text: str, names: Mapping[str, str] | None = None) -> Iterator[tuple[int, str, str]]:
    """Yield where a text may say something of somebody, what kind of thing, and what it says.

    Args:
        text: any.
        names: what else to look for -> what it is, see `this_machine.names_here`.
    """
    for what, rule, before in _RULES:
        for found in rule.finditer(text):
            first = max(found.start() - _BEFORE, 0)
            begins = before.search(text[first : found.start()])
            if begins is not None:
                at = first + begins.start()
                yield at, what, text[at : found.end()][:_SHOWN]
    for name, what in (names or {}).items():
        pattern = rf"(?<![A-Za-z0-9]){re.escape(name)}(?![A-Za-z0-9])"
        for found in re.finditer(pattern, text, re.IGNORECASE):
            yield found.start(), what, found[0][:_SHOWN]


def in_value(field: str, value: object) -> Iterator[tuple[str, str]]:
    """Yield what the value of a field says of somebody because of the field's name."""
    text = str(value).strip()
    if re.sub(r"[^a-z]", "", field.lower().rpartition(":")[2]) in _PEOPLE:
        told = isinstance(value, str | int | float) and not isinstance(value, bool)
        if told and text not in ("", "0") and not text.lower().startswith("urbantwin"):
            yield "name of a person", f"{field}: {text}"[:_SHOWN]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and _TIME.search(field) and _is_moment(float(text)):
        yield "time stamp", f"{field}: {text}"[:_SHOWN]


def _is_moment(value: float) -> bool:
    """Return whether a number is a moment of our time, as clocks of recordings tell it."""
    return any(_FIRST_S <= value / unit <= _LAST_S for unit in (1.0, 1e3, 1e6, 1e9))
