"""What in a text, and under which names, may say something of a person, a machine or a moment."""

from __future__ import annotations

import getpass
import os
import re
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

__all__ = ["in_text", "in_value", "names_here"]

#: Folders that absolute paths begin with, on Linux, on macOS and in containers.
_ROOTS = (
    "home|Users|root|tmp|var|mnt|media|opt|usr|srv|data|etc|private|Volumes|work|workspace|"
    "workspaces|scratch|nfs|app|build|builds|code|run|storage|content|kaggle|gpfs|lustre|afs|"
    "shared|share|local|cygdrive|export|net|lhome|u|users|datasets"
)
_END = r"[^\s\"'<>|;,)\]}]"
_DAY = r"(?:0[1-9]|[12]\d|3[01])"
_PATH, _MAIL, _TIME, _NAME = "absolute path", "e-mail address", "time stamp", "name of a person"
#: Kind -> a pattern that begins with rare letters, which is fast to find, and what must stand
#: directly before it.
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
            # The day on which Unix's clock begins is nobody's: writers of FBX put it there.
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
#: Characters before a pattern that are searched for what must stand there.
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
#: Seconds since 1970 of 1995 and of 2040; recordings count in s, ms, us or ns.
_FIRST_S, _LAST_S = 788_918_400.0, 2_208_988_800.0
#: Largest number of characters of a finding that are shown.
_SHOWN = 120
#: Names that many machines have, and words that mean something else; shorter names are words, too.
_COMMON = frozenset(
    "root user users admin administrator ubuntu debian fedora runner docker nobody guest home "
    "localhost localdomain work test default build jenkins vagrant node pi car bus van tram pole "
    "site main data dataset twin".split()
)
_SHORTEST = 4


def in_text(text: str, names: Mapping[str, str] | None = None) -> Iterator[tuple[int, str, str]]:
    """Yield where a text may say something of somebody, what kind of thing, and what it says.

    Args:
        text: any.
        names: what else to search for -> what it is, see `names_here`.
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
    """Return the names of the user, the machine, the home and the current folder -> what each is.

    Names that many machines have (``root``, ``ubuntu``) and very short ones are left out.
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
