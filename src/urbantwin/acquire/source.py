"""Interface of sources of inputs."""

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

#: Margin around the region for heights, points, buildings and pictures, metres.
MARGIN_M = 60.0


@dataclass(frozen=True)
class AcquiredInput:
    """An input acquired from a source.

    Attributes:
        kind: kind of input.
        source: the source.
        path: the written file, or ``None`` for data that the build requests itself.
        url: requested server, without key and query.
        at: time of the oldest response, UTC, ISO 8601.
        fields: further fields in ``site.yaml``: ``crs``, ``url``, ``key_env``.
        told: description: ``11,025 points``.
        crs: CRS of its heights, as WKT; empty if it has none.
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
    """A source: its coverage, and access to its data."""

    @property
    def spec(self) -> SourceSpec:
        """Its row of the table."""
        ...

    def covers(self, area: Area) -> bool:
        """Return whether the source may have data in an area, without a request."""
        ...

    def fetch(self, area: Area, web: Web, folder: Path, progress: Progress) -> AcquiredInput:
        """Write the source's data of an area into a folder.

        Raises:
            NotAcquiredError: no usable data there.
            DownloadError: the download failed.
        """
        ...


#: Function that fetches from sources with one access method.
Fetch = Callable[[SourceSpec, Area, Web, Path, Progress], AcquiredInput]


@dataclass(frozen=True)
class ListedSource:
    """A source of the table.

    Attributes:
        spec: its row.
        how: its fetch function.
    """

    spec: SourceSpec
    how: Fetch

    def covers(self, area: Area) -> bool:
        """Return whether its boxes intersect the area, and its countries hold the centre."""
        return self.spec.covers(area.box(MARGIN_M), country_of(area.latitude, area.longitude))

    def fetch(self, area: Area, web: Web, folder: Path, progress: Progress) -> AcquiredInput:
        """Write the source's data of an area into a folder."""
        return self.how(self.spec, area, web, folder, progress)
