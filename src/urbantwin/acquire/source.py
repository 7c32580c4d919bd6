"""One source of inputs: the interface behind which every kind of server stands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from urbantwin.acquire.area import Area
from urbantwin.acquire.source_table import Kind, SourceSpec
from urbantwin.acquire.web import Web
from urbantwin.progress import Progress
from urbantwin.site.country import country_of

__all__ = ["MARGIN_M", "AcquiredInput", "Fetch", "Source"]

#: How far beyond the region heights, points, buildings and pictures are fetched, metres.
MARGIN_M = 60.0


@dataclass(frozen=True)
class AcquiredInput:
    """What a source had.

    Attributes:
        kind: of what it is.
        source: the source.
        path: the file that was written, or ``None`` for what a build asks for itself.
        url: who was asked, without a key and without what was asked for.
        at: when the answers came, UTC, ISO 8601: the oldest of them.
        fields: what else ``site.yaml`` says of it: ``crs``, ``url``, ``key_env``.
        told: what it is, in words: ``11,025 points``.
        crs: of its heights, as WKT; empty where it has none.
    """

    kind: Kind
    source: SourceSpec
    path: Path | None
    url: str
    at: str
    fields: Mapping[str, str] = field(default_factory=dict)
    told: str = ""
    crs: str = ""


class Source(Protocol):
    """A source: what it covers, and how what it has comes into a file."""

    @property
    def spec(self) -> SourceSpec:
        """Its row of the table."""
        ...

    def covers(self, area: Area) -> bool:
        """Return whether it may have something there; nobody is asked."""
        ...

    def fetch(self, area: Area, web: Web, folder: Path, progress: Progress) -> AcquiredInput:
        """Write what it has of an area into a folder.

        Raises:
            NotAcquiredError: it has nothing there, or what it has is of no use.
            DownloadError: it cannot be asked.
        """
        ...


#: How a source of one access is asked.
Fetch = Callable[[SourceSpec, Area, Web, Path, Progress], AcquiredInput]


@dataclass(frozen=True)
class ListedSource:
    """A source of the table.

    Attributes:
        spec: its row.
        how: what asks it.
    """

    spec: SourceSpec
    how: Fetch

    def covers(self, area: Area) -> bool:
        """Return whether its boxes meet the area, and the area's middle is in its countries."""
        return self.spec.covers(area.box(MARGIN_M), country_of(area.latitude, area.longitude))

    def fetch(self, area: Area, web: Web, folder: Path, progress: Progress) -> AcquiredInput:
        """Write what it has of an area into a folder."""
        return self.how(self.spec, area, web, folder, progress)
