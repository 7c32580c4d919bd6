"""Files of third parties: licence, origin, and a check that they are unchanged."""

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
    """A file of a third party, with its licence and attribution."""

    path: Path
    licence: str
    attribution: str


class FetchedSpec(BaseModel):
    """Record of a fetched input, written by ``urbantwin init --at``.

    Attributes:
        source: name in the table of sources.
        url: requested address, without any key.
        at: time of the response, ISO 8601, UTC.
        sha256: SHA-256 of the written file.
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
    """Check that a fetched file is unchanged.

    Args:
        document: the ``site.yaml``.
        location: location of the input in it.
        path: the input's file.
        fetched: its record; no check without.

    Raises:
        InputError: the SHA-256 differs.
    """
    if fetched is not None and path.is_file() and sha256_of(path) != fetched.sha256:
        raise document.error(
            f"{str(path)!r} is not what was fetched: its SHA-256 is another",
            (*location, "fetched", "sha256"),
            "the file as it was fetched, or no `fetched` where you changed it",
        )


@dataclass(frozen=True)
class FetchedInput:
    """A fetched input, for an initial ``site.yaml``.

    Attributes:
        kind: ``map``, ``elevation``, ``airborne``, ``buildings``, ``imagery`` or ``tiles``.
        path: its file; ``None`` for data requested during a build.
        licence: licence.
        attribution: required attribution.
        fetched: record of the fetched file.
        fields: further fields: ``crs``, ``url``, ``key_env``.
        caution: warning about its data, a sentence.
    """

    kind: str
    path: Path | None
    licence: str
    attribution: str
    fetched: FetchedSpec | None
    fields: Mapping[str, str] = field(default_factory=dict)
    caution: str = ""
