"""Files that others made: on which terms, where fetched from, and whether they still are that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator

from urbantwin.artefact import sha256_of
from urbantwin.site.yaml_document import Document, wrong

__all__ = ["FetchedInput", "FetchedSpec", "InputFile", "check_fetched"]


@dataclass(frozen=True)
class InputFile:
    """A file that others made: where it is, and on what terms it may be used."""

    path: Path
    licence: str
    attribution: str


class FetchedSpec(BaseModel):
    """What ``urbantwin init --at`` notes of an input.

    Attributes:
        source: its name in the table of sources.
        url: who was asked, without any key.
        at: when, ISO 8601, UTC.
        sha256: of the file as it was written then.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    source: Annotated[str, Field(min_length=1)]
    url: Annotated[str, Field(min_length=1)]
    at: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$", description="64 hexadecimal digits")]

    @field_validator("at")
    @classmethod
    def _is_a_time(cls, value: str) -> str:
        try:
            datetime.fromisoformat(value)
        except ValueError:
            raise wrong(f"is {value!r:.60}", "a time such as 2026-11-26T16:00:00Z") from None
        return value


def check_fetched(
    document: Document, location: tuple[int | str, ...], path: Path, fetched: FetchedSpec | None
) -> None:
    """Check that a file is what was fetched.

    Args:
        document: the ``site.yaml``.
        location: of the input in it.
        path: the input's file.
        fetched: what is noted of it; nothing is checked without.

    Raises:
        InputError: its SHA-256 is another.
    """
    if fetched is not None and path.is_file() and sha256_of(path) != fetched.sha256:
        raise document.error(
            f"{str(path)!r} is not what was fetched: its SHA-256 is another",
            (*location, "fetched", "sha256"),
            "the file as it was fetched, or no `fetched` where you changed it",
        )


@dataclass(frozen=True)
class FetchedInput:
    """An input that was fetched, as a first ``site.yaml`` names it.

    Attributes:
        kind: ``map``, ``elevation``, ``airborne``, ``buildings``, ``imagery`` or ``tiles``.
        path: its file; ``None`` for what is asked for during a build.
        licence: on what terms it may be used.
        attribution: whom to name.
        fetched: what is noted of the file.
        fields: what else is said of it: ``crs``, ``url``, ``key_env``.
        caution: what to know of its data, a sentence.
    """

    kind: str
    path: Path | None
    licence: str
    attribution: str
    fetched: FetchedSpec | None
    fields: Mapping[str, str] = field(default_factory=dict)
    caution: str = ""
