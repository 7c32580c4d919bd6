"""A ``site.yaml`` as a document that is changed, built and written elsewhere."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from urbantwin.artefact import write_json
from urbantwin.progress import Progress
from urbantwin.site import load_site
from urbantwin.site.yaml_document import read_document
from urbantwin.twin import Twin
from urbantwin.twin.build import build_twin

__all__ = ["built", "document_of", "write_calibrated"]

_LONGEST_NAME = 500


def document_of(site: Path) -> dict[str, Any]:
    """Return a site's document, its files named from anywhere."""
    document = dict(read_document(site, kind="a site").value)
    return dict(_elsewhere(document, site.parent.resolve(), None))


def write_calibrated(
    folder: Path,
    document: dict[str, Any],
    traffic: dict[str, Any],
    report: dict[str, Any],
    *,
    files: tuple[Path, Path],
) -> None:
    """Write what a calibration leaves: ``site.yaml``, ``traffic.yaml``, ``calibration.json``.

    Args:
        folder: where they are written.
        document: the site's, as `document_of` returns it.
        traffic: what was found, in place of the document's.
        report: how it was found.
        files: the folder of the site, and the one that they will be in.
    """
    document["traffic"] = {**dict(document.get("traffic") or {}), **traffic}
    here, there = files
    _dump(folder / "site.yaml", _elsewhere(document, here.resolve(), there.resolve()))
    _dump(folder / "traffic.yaml", traffic)
    write_json(folder / "calibration.json", report)


def _elsewhere(value: Any, here: Path, there: Path | None, key: str = "") -> Any:  # noqa: ANN401
    """Return a site's document with its files as they are called from another folder, or whole."""
    if isinstance(value, dict):
        return {name: _elsewhere(one, here, there, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_elsewhere(one, here, there, key) for one in value]
    if isinstance(value, str) and value and "\n" not in value and len(value) < _LONGEST_NAME:
        file = here / value
        # A folder stands where files do: of tiles, of frames. A place may be called as one is.
        if file.is_file() or (key == "file" and file.is_dir()):
            return str(file) if there is None else os.path.relpath(file, there)
    return value


def built(document: dict[str, Any], folder: Path, progress: Progress) -> Twin:
    """Return the twin of a site's document, built in a folder that passes."""
    file = folder / "site.yaml"
    _dump(file, document)
    return build_twin(load_site(file), folder / "twin", progress)


def _dump(path: Path, value: dict[str, Any]) -> None:
    """Write a document as YAML."""
    path.write_text(
        yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=100), encoding="utf-8"
    )
