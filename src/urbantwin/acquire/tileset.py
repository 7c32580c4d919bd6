"""3D Tiles at an address: named in ``site.yaml``, where a build asks for what it needs of them."""

from __future__ import annotations

from pathlib import Path

from urbantwin.acquire.answer_cache import now
from urbantwin.acquire.area import Area
from urbantwin.acquire.source import AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, Web
from urbantwin.progress import Progress

__all__ = ["name_tileset"]


def name_tileset(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Name a tileset; nothing of it is fetched, since providers forbid keeping tiles."""
    server = web.server(spec)  # which looks for the key
    if web.offline:
        raise NotAcquiredError("is asked during the build, and offline nobody is asked")
    fields = {"url": spec.address}
    if spec.key_env is not None:
        fields["key_env"] = spec.key_env
    told = "asked during the build"
    return AcquiredInput("tiles", spec, None, server.shown(spec.address), now(), fields, told)
