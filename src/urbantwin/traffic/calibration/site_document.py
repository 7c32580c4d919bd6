"""A ``site.yaml`` as a document that is changed, built and written to another folder."""

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
    """Return a site's document with absolute paths of files."""
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
    """Write the results of a calibration: ``site.yaml``, ``traffic.yaml``, ``calibration.json``.

    Args:
        folder: folder to write to.
        document: the site's document, from `document_of`.
        traffic: fields of ``traffic``, which replace the document's.
        report: the report.
        files: the folder of the site, and the final folder of the results.
    """
    document["traffic"] = {**dict(document.get("traffic") or {}), **traffic}
    source, target = files
    _dump(folder / "site.yaml", _elsewhere(document, source.resolve(), target.resolve()))
    _dump(folder / "traffic.yaml", traffic)
    write_json(folder / "calibration.json", report)


def _elsewhere(value: Any, here: Path, there: Path | None, key: str = "") -> Any:  # noqa: ANN401
    """Return a document with file paths relative to another folder, or absolute."""
    if isinstance(value, dict):
        return {name: _elsewhere(item, here, there, name) for name, item in value.items()}
    if isinstance(value, list):
        return [_elsewhere(item, here, there, key) for item in value]
    if isinstance(value, str) and value and "\n" not in value and len(value) < _LONGEST_NAME:
        file = here / value
        # Some entries name a folder of files: of tiles, of frames. Other values may equal a
        # folder's name.
        if file.is_file() or (key == "file" and file.is_dir()):
            return str(file) if there is None else os.path.relpath(file, there)
    return value


def built(document: dict[str, Any], folder: Path, progress: Progress) -> Twin:
    """Return the twin of a site's document, built in a temporary folder."""
    file = folder / "site.yaml"
    _dump(file, document)
    return build_twin(load_site(file), folder / "twin", progress)


def _dump(path: Path, value: dict[str, Any]) -> None:
    """Write a document as YAML."""
    path.write_text(
        yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=100), encoding="utf-8"
    )
