"""A made place on a server of this machine, and who fetches from it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml

from urbantwin.acquire import AnswerCache, Area, SourceSpec, Web, sources_of
from urbantwin.acquire.acquire import acquire_inputs
from urbantwin.download import client as client_module
from urbantwin.download import keys_allowed

from .local_web import Web as Server
from .local_web import serving
from .made_world import LATITUDE, LONGITUDE, row, world


@pytest.fixture(autouse=True)
def here_and_now(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pauses, and no proxies of whoever runs the tests."""
    monkeypatch.setattr(client_module, "PAUSE_S", 0.001)
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


@pytest.fixture(scope="session")
def made() -> Iterator[Server]:
    """The server of the made place; tests that change it use `server`."""
    with serving() as web:
        world(web)
        yield web


@pytest.fixture
def server(made: Server) -> Iterator[Server]:
    """The same, as it was made: what a test changes is undone."""
    files, answers = dict(made.files), dict(made.answers)
    made.asked.clear()
    yield made
    made.files, made.answers, made.faults = files, answers, {}


@pytest.fixture
def area() -> Area:
    return Area.checked(LATITUDE, LONGITUDE, 100.0)


@pytest.fixture
def fetch(server: Server, area: Area, tmp_path: Path) -> Callable[..., Any]:
    """``fetch(rows)``: what is had of the place from rows of a table, the map's if none is told."""

    def fetched(
        *rows: dict,
        offline: bool = False,
        cache: Path | None = None,
        environment: dict | None = None,
        folder: str = "inputs",
        **more: Any,
    ) -> Any:
        table = list(rows)
        if not any(one["kind"] == "map" for one in rows):
            table.append(row(server, "osm", "map", "overpass", "/api/interpreter"))
        specs = [SourceSpec.model_validate(one) for one in table]
        kept = AnswerCache(cache or tmp_path / "cache")
        web = Web(kept, offline=offline, environment=environment or {}, **more)
        out = tmp_path / folder
        out.mkdir(exist_ok=True)
        origin = f"http://{urlsplit(server.url).netloc}"
        with keys_allowed(None, [f"{name}={origin}" for name in environment or ()]):
            found = acquire_inputs(area, out, sources_of(specs), web)
        by_kind = {one.kind: one for one in found.inputs}
        outcome = {one.source: one for one in found.attempts if one.source}
        return SimpleNamespace(found=found, inputs=by_kind, outcome=outcome, folder=out)

    return fetched


@pytest.fixture
def own_table(tmp_path: Path) -> Callable[..., Path]:
    """``own_table(rows)``: a table of sources in a file."""

    def written(*rows: dict) -> Path:
        path = tmp_path / "own-sources.yaml"
        path.write_text(yaml.safe_dump({"sources": list(rows)}))
        return path

    return written
