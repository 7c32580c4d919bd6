"""Rules for texts and field names that may reveal a person, a machine or a time."""

from __future__ import annotations

import getpass
import os
import re
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

__all__ = ["in_text", "in_value", "names_here"]

#: First folders of absolute paths on Linux, on macOS and in containers.
_ROOTS = (
    "home|Users|root|tmp|var|mnt|media|opt|usr|srv|data|etc|private|Volumes|work|workspace|"
    "workspaces|scratch|nfs|app|build|builds|code|run|storage|content|kaggle|gpfs|lustre|afs|"
    "shared|share|local|cygdrive|export|net|lhome|u|users|datasets"
)
_END = r"[^\s\"'<>|;,)\]}]"
_DAY = r"(?:0[1-9]|[12]\d|3[01])"
_PATH, _MAIL, _TIME, _NAME = "absolute path", "e-mail address", "time stamp", "name of a person"
#: Kinds with a pattern that begins with rare characters, for speed, and a pattern required directly
#: before it.
_RULES = [
    (kind, re.compile(rule), re.compile(before))
    for kind, rule, before in (
        (_PATH, rf"/(?:{_ROOTS})/{_END}+", r"(?<![\w.\-/~<])$"),
        (_PATH, rf"file:///?{_END}+", "$"),
        (_PATH, rf":(?:\\{{1,2}}|/(?!/)){_END}+", r"(?<![A-Za-z0-9])[A-Za-z]$"),
        (_PATH, rf"\\\\[\w.\-]+\\{_END}+", r"(?<![\\\w])$"),
        (_PATH, rf"~[\w\-]*/[\w.]{_END}*", r"(?<![\w/.])$"),
        (
            _MAIL,
            r"@(?!\d+x\.)[A-Za-z0-9\-]+(?:\.[A-Za-z0-9\-]+)*\.[A-Za-z]{2,}\b",
            r"[\w.+\-]+$",
        ),
        (
            _TIME,
            # The first day of Unix time reveals nothing: FBX writers use it.
            rf"(?!1970-01-01)(?:19|20)\d\d([-:/.])(?:0[1-9]|1[0-2])\1{_DAY}[T _]"
            # Midnight is a date in formats that ask for a moment.
            r"(?!00[:\-]00(?![:\-](?!00)\d))(?:[01]\d|2[0-3])[:\-][0-5]\d|"
            rf"(?:19|20)\d\d(?:0[1-9]|1[0-2]){_DAY}[T_\-](?:[01]\d|2[0-3])[0-5]\d[0-5]\d(?!\d)",
            r"(?<!\d)$",
        ),
        (
            _TIME,
            r"(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun),? +(?:\d{1,2} )?(?:Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|"
            r"Sep|Oct|Nov|Dec)(?: +\d{1,2})?(?: \d{4})? \d\d:\d\d",
            r"(?<!\w)$",
        ),
        (
            _NAME,
            # Attributes of XML: OpenStreetMap's mappers, and authors of documents.
            r"""=\s*(?:"(?!urbantwin|UrbanTwin)[^"]+"|'(?!urbantwin|UrbanTwin)[^']+')""",
            r"(?<![\w:])(?i:user|uid|username|changeset|author|creator|owner|hostname|annotator)"
            r"\s*$",
        ),
    )
]
#: Characters before a match that are searched for the required prefix.
_BEFORE = 80
#: Names of fields that hold people, their machines, vehicles or numbers.
_PEOPLE = frozenset(
    "user username userid uid author authors creator createdby modifiedby owner annotator "
    "annotatedby hostname host hostcomputer computer computername email mail phone telephone "
    "plate licenceplate licenseplate numberplate registrationplate vin drivername artist "
    "changeset login account homedir workdir cwd".split()
)
_TIME_FIELD = re.compile(
    r"(?i)(time|stamp|clock|epoch|date|begin|start|stop|utc|gps|created|modified|captured)|"
    r"(^|_)t$|_(s|ms|us|ns)$"
)
#: Range of plausible time stamps, seconds since 1970: 1995 to 2040; recordings use s, ms, us or ns.
_FIRST_S, _LAST_S = 788_918_400.0, 2_208_988_800.0
#: Largest number of characters of a finding that are shown.
_SHOWN = 120
#: Names of many machines, and words with other meanings; shorter names are words as well.
_COMMON = frozenset(
    "root user users admin administrator ubuntu debian fedora runner docker nobody guest home "
    "localhost localdomain work test default build jenkins vagrant node pi car bus van tram pole "
    "site main data dataset twin".split()
)
_SHORTEST = 4


def in_text(text: str, names: Mapping[str, str] | None = None) -> Iterator[tuple[int, str, str]]:
    """Yield position, kind and text of possible personal data in a text.

    Args:
        text: any text.
        names: further texts to search for -> their kind, see `names_here`.
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
    """Yield kind and text of personal data in a value, judged by the name of its field."""
    if not isinstance(value, str | int | float) or isinstance(value, bool):
        return
    text = str(value).strip()
    named = re.sub(r"[^a-z]", "", field.lower().rpartition(":")[2]) in _PEOPLE
    if named and text not in ("", "0") and not text.lower().startswith("urbantwin"):
        yield _NAME, f"{field}: {text}"[:_SHOWN]
    if isinstance(value, str) or not _TIME_FIELD.search(field):
        return
    if any(_FIRST_S <= value / unit <= _LAST_S for unit in (1.0, 1e3, 1e6, 1e9)):
        yield _TIME, f"{field}: {text}"[:_SHOWN]


def names_here() -> dict[str, str]:
    """Return the names of the user, the machine, the home and the current folder -> their kind.

    Very common (``root``, ``ubuntu``) and very short names are omitted.
    """
    found: dict[str, str] = {}
    with suppress(OSError, KeyError, ImportError):
        user = getpass.getuser()
        found[user] = "name of the user"
        import pwd

        for part in re.split(r"[,\s]+", pwd.getpwnam(user).pw_gecos):
            found.setdefault(part, "name of the user")
    with suppress(OSError):
        for part in (socket.gethostname(), socket.gethostname().partition(".")[0]):
            found.setdefault(part, "name of this machine")
    kept = {
        name: what
        for name, what in found.items()
        if len(name) >= _SHORTEST and name.lower() not in _COMMON and not name.isdigit()
    }
    with suppress(OSError, RuntimeError):
        for folder, what in ((Path.home(), "home folder"), (Path.cwd(), "current folder")):
            if len(folder.parts) > 2 or (len(folder.parts) > 1 and folder != Path("/root")):
                kept[os.fspath(folder)] = what
    return kept
