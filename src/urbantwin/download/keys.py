"""Keys of servers: which environment variables may be read, and where each may be sent.

A file that names a variable and a server (``site.yaml``, a table of sources) may be untrusted. So
the user decides, not the file: a variable whose name does not begin with ``URBANTWIN_`` must be
named on the command line, and every pair of variable and origin must be allowed there or in a file
of the user's configuration folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from platformdirs import user_config_path

from urbantwin.download.address import DownloadError, Origin, parse_address, parse_origin
from urbantwin.errors import InputError

__all__ = ["PREFIX", "VARIABLE", "allowed_keys_file", "key_for", "keys_allowed", "no_keys"]

#: Prefix of variables that hold keys for UrbanTwin only.
PREFIX = "URBANTWIN_"
#: Pattern of a variable's name.
VARIABLE = r"^[A-Za-z_][A-Za-z0-9_]*$"

Pair = tuple[str, Origin]


@dataclass(frozen=True)
class _Allowed:
    """Permissions given by the caller of a command.

    Attributes:
        names: permitted variables without the prefix.
        pairs: variables with origins that their values may be sent to.
        none: whether reading keys is forbidden.
    """

    names: frozenset[str] = field(default_factory=frozenset)
    pairs: frozenset[Pair] = field(default_factory=frozenset)
    none: bool = False


_allowed: ContextVar[_Allowed] = ContextVar("allowed_keys")


def allowed_keys_file() -> Path:
    """Return the file in the user's configuration folder with lines ``NAME=https://host``.

    Empty lines and lines that begin with ``#`` are ignored.
    """
    return user_config_path("urbantwin", appauthor=False) / "allowed-keys"


@contextmanager
def keys_allowed(names: Iterable[str] | None, pairs: Iterable[str] | None) -> Iterator[None]:
    """Allow keys while the block runs, besides those of `allowed_keys_file`.

    Args:
        names: permitted variables (``--key-env``).
        pairs: ``NAME=https://host:port``: permitted variables with the server that the value may be
            sent to (``--allow-key``).

    Raises:
        InputError: a name or a pair is malformed.
    """
    named = set()
    for name in names or ():
        if not re.fullmatch(VARIABLE, name):
            raise InputError(
                f"is {name!r:.60}", place="--key-env", expected="the name of a variable: TILES_KEY"
            )
        named.add(name)
    allowed = frozenset(_pair(one, place="--allow-key") for one in pairs or ())
    rules = _Allowed(frozenset(named | {name for name, _ in allowed}), allowed)
    before = _allowed.set(rules)
    try:
        yield
    finally:
        _allowed.reset(before)


@contextmanager
def no_keys() -> Iterator[None]:
    """Forbid reading keys while the block runs."""
    before = _allowed.set(_Allowed(none=True))
    try:
        yield
    finally:
        _allowed.reset(before)


def key_for(
    name: str,
    address: str,
    environment: Mapping[str, str] | None = None,
    *,
    file: Path | None = None,
    place: str | None = None,
) -> str:
    """Return the key in a variable, for an address that it may be sent to.

    Args:
        name: name of the variable, as given in a file.
        address: address to send it to; placeholders in braces are allowed in path and query.
        environment: environment variables; the process's own if not given.
        file: file that names both.
        place: place in the file.

    Returns:
        The key; empty if the variable is not set.

    Raises:
        InputError: not allowed by the user; the message has the option that allows it.
        DownloadError: the address is invalid.
    """
    origin = parse_address(re.sub(r"\{[^}]*\}", "0", address)).origin
    rules = _allowed.get(_Allowed())
    if not re.fullmatch(VARIABLE, name) or rules.none:
        raise InputError(
            f"asks for the variable {name!r:.60}, and no key is read here",
            file=file,
            place=place,
            expected="an address without a key, or what is at it as a file",
        )
    listed = frozenset() if (name, origin) in rules.pairs else _listed()
    named = name.startswith(PREFIX) or name in rules.names
    if (name, origin) not in rules.pairs | listed:
        also = f", or the line {name}={origin} in {allowed_keys_file()}" if named else ""
        raise InputError(
            f"would send the variable {name} to {origin}, which you have not allowed",
            file=file,
            place=place,
            expected=f"--allow-key {name}={origin}{also}",
        )
    if not named:
        raise InputError(
            f"names the variable {name}, which does not begin with {PREFIX}",
            file=file,
            place=place,
            expected=f"--key-env {name}",
        )
    return (os.environ if environment is None else environment).get(name, "").strip()


def _listed() -> frozenset[Pair]:
    """Return the pairs in the user's file; empty without the file.

    Raises:
        InputError: the file cannot be read, or a line of it is malformed.
    """
    file = allowed_keys_file()
    try:
        text = file.read_text(encoding="utf-8")
    except (FileNotFoundError, NotADirectoryError):
        return frozenset()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "not UTF-8"
        raise InputError(f"cannot be read ({why})", file=file) from None
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return frozenset(
        _pair(line, place=f"line {number}", file=file)
        for number, line in lines
        if line and not line.startswith("#")
    )


def _pair(text: str, *, place: str, file: Path | None = None) -> Pair:
    name, _, origin = text.partition("=")
    try:
        if not re.fullmatch(VARIABLE, name.strip()):
            raise DownloadError("is not the name of a variable")
        return name.strip(), parse_origin(origin.strip())
    except DownloadError:
        raise InputError(
            f"is {text!r:.100}",
            file=file,
            place=place,
            expected="NAME=https://host or NAME=https://host:port, without a path",
        ) from None
