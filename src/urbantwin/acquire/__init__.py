"""Inputs of a place, fetched from public sources, with origin and licence."""

from __future__ import annotations

from urbantwin.acquire.acquire import Acquired, Attempt, acquire_inputs, sources_of
from urbantwin.acquire.answer_cache import AnswerCache, usual_cache
from urbantwin.acquire.area import Area, parse_place
from urbantwin.acquire.place_name import NamedPlace, find_place
from urbantwin.acquire.source import AcquiredInput, Source
from urbantwin.acquire.source_table import SourceSpec, chosen_sources, known_sources
from urbantwin.acquire.web import NotAcquiredError, Web

__all__ = [
    "Acquired",
    "AcquiredInput",
    "AnswerCache",
    "Area",
    "Attempt",
    "NamedPlace",
    "NotAcquiredError",
    "Source",
    "SourceSpec",
    "Web",
    "acquire_inputs",
    "chosen_sources",
    "find_place",
    "known_sources",
    "parse_place",
    "sources_of",
    "usual_cache",
]
