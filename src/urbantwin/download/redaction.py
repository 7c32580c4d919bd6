"""Redaction of keys in what servers say."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from urllib.parse import quote, quote_plus, unquote, unquote_plus

__all__ = ["Secrets"]

#: A secret is looked for inside of texts from so many characters on: of a shorter one everything
#: seems to hold it.
SHORTEST = 4


class Secrets:
    """What must reach neither another origin nor a report.

    Args:
        known: the secrets, as they are.
    """

    def __init__(self, known: Iterable[str]) -> None:
        self._known = tuple(known)
        ways = (str, partial(quote, safe=""), quote, quote_plus)
        written = {way(one) for one in self._known if len(one) >= SHORTEST for way in ways}
        self._written = tuple(sorted(written, key=lambda form: (-len(form), form)))

    def hidden(self, text: str) -> str:
        """Return a text without any of them."""
        for form in self._written:
            text = text.replace(form, "***")
        return text

    def held_by(self, data: bytes) -> bool:
        """Return whether a server wrote one of them into what it answered."""
        return any(form.encode() in data for form in self._written)

    def told_in(self, text: str) -> bool:
        """Return whether a part of an address (``name=value``) holds one, however encoded."""
        forms = {text, text.partition("=")[2]}
        for undo in (unquote, unquote_plus, unquote, unquote_plus):
            forms |= {undo(form) for form in forms}
        lowered = {form.lower() for form in forms}
        for secret in (one.lower() for one in self._known):
            inside = len(secret) >= SHORTEST and any(secret in form for form in lowered)
            if inside or secret in lowered:
                return True
        return False
