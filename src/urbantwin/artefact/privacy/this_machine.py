"""The names that this machine and its user have, which no file that is passed on should hold."""

from __future__ import annotations

import getpass
import os
import re
import socket
from contextlib import suppress
from pathlib import Path

__all__ = ["names_here"]

#: Names that many have, and words that mean something else.
_COMMON = frozenset(
    "root user users admin administrator ubuntu debian fedora runner docker nobody guest home "
    "localhost localdomain work test default build jenkins vagrant node pi car bus van tram pole "
    "site main data dataset twin".split()
)
_SHORTEST = 4


def names_here() -> dict[str, str]:
    """Return the names of the user, the machine, the home and the current folder -> what each is.

    Names that many machines have (``root``, ``ubuntu``) and very short ones are left out: they are
    words of other texts, too.
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
