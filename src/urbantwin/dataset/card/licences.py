"""Sources of a dataset, and the obligations of their licences for redistribution."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["consequences", "hub_licence", "stated"]

#: Licence, as people write it -> what hubs call it, and what follows for what is derived from it:
#: the licences' own texts, in short. The first that fits counts.
_LICENCES = (
    (
        r"odbl|open database licen[cs]e",
        "odbl",
        "name the source; a derivative database that is passed on has to be under the ODbL, too "
        "(4.4); a produced work, as pictures are, only names the source (4.3). Which of the two "
        "frames and labels are is not settled: as a derivative database they are on the safe side",
    ),
    (
        r"cc[ -]?by[ -]?nc[ -]?sa",
        "cc-by-nc-sa-4.0",
        "name the author; no commercial use; pass on what is derived under the same licence",
    ),
    (
        r"cc[ -]?by[ -]?nc[ -]?nd",
        "cc-by-nc-nd-4.0",
        "name the author; no commercial use; what is derived from it may not be passed on",
    ),
    (r"cc[ -]?by[ -]?nc", "cc-by-nc-4.0", "name the author; no commercial use"),
    (
        r"cc[ -]?by[ -]?nd",
        "cc-by-nd-4.0",
        "name the author; what is derived from it may not be passed on",
    ),
    (
        r"cc[ -]?by[ -]?sa",
        "cc-by-sa-4.0",
        "name the author; pass on what is derived under the same licence",
    ),
    (r"cc[ -]?by|creative commons attribution", "cc-by-4.0", "name the author, say what changed"),
    (r"cc[ -]?0|public domain|pddl", "cc0-1.0", "nothing"),
    (r"odc[ -]?by", "odc-by", "name the source"),
    (r"dl-de[/ -]by|datenlizenz deutschland.*namensnennung", "other", "name the source"),
    (r"dl-de[/ -]zero", "other", "nothing"),
    (r"open government licen[cs]e|\bogl\b", "other", "name the source"),
    (r"apache", "apache-2.0", "keep its notices; say what changed"),
    (r"\bmit\b", "mit", "keep its notice"),
    (r"\bbsd\b", "bsd-3-clause", "keep its notice"),
    (r"mpl", "mpl-2.0", "keep changed files of it open"),
)
_UNSAID = ("", "not stated", "unknown", "none")


def consequences(inputs: Iterable[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return each licence among the inputs, and what follows from it, in short.

    A licence that is not known here says to read it; none that is stated, to find it out.
    """
    found = {}
    for one in inputs:
        text = stated(one.get("licence"))
        known = _known(text)
        if text is None:
            found["not stated"] = (
                "find out: without a licence nobody may pass on what was made from it"
            )
        else:
            found[text] = known[1] if known else "not known to UrbanTwin: read it before passing on"
    return list(found.items())


def hub_licence(inputs: Iterable[Mapping[str, Any]]) -> str:
    """Return what a hub calls the licence of a dataset: ``unknown`` where an input states none.

    ``other`` where inputs have several that ask for something, or one that hubs have no name for:
    then the card's own section counts.
    """
    names = set()
    for one in inputs:
        text = stated(one.get("licence"))
        if text is None:
            return "unknown"
        known = _known(text)
        names.add(known[0] if known and _version_fits(text, known[0]) else "other")
    binding = names - {"cc0-1.0"} or names
    return binding.pop() if len(binding) == 1 else "other" if names else "unknown"


def stated(text: object) -> str | None:
    """Return a licence or an attribution as it was stated, or None."""
    said = " ".join(str(text or "").split())
    return None if said.lower() in _UNSAID else said


def _known(text: str | None) -> tuple[str, str] | None:
    return next(
        (
            (hub, asks)
            for pattern, hub, asks in _LICENCES
            if text and re.search(pattern, text, re.I)
        ),
        None,
    )


def _version_fits(text: str, hub: str) -> bool:
    """Return whether a licence's version, where it is said, is that of the hub's name for it."""
    versions = re.findall(r"\d+\.\d+", text)
    named = re.findall(r"\d+\.\d+", hub)
    return not named or hub == "cc0-1.0" or versions[:1] == named
