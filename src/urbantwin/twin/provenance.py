"""Provenance of a twin: the site and every input file, for reproduction."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import sha256_of
from urbantwin.reconstruct.actor_mesh import buffers_beside
from urbantwin.site import Site
from urbantwin.site.geotiff import files_beside
from urbantwin.twin.sensor_files import pattern_beside, sensor_file

__all__ = ["made_from", "rig_and_files", "without_secrets"]

#: Credentials in an address: user, password and query.
_SECRET = re.compile(r"(?<=//)[^/@]*@|[?#].*")


def made_from(
    site: Site,
    geometry: Mapping[str, Any] | None = None,
    pictures: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return the site and its files, for ``twin.json``.

    Args:
        site: the site.
        geometry: ``geometry.json``, which lists the files of its sources.
        pictures: notes of ``read_orthophoto`` about each image of the ground.

    Returns:
        ``site``: the resolved site with its rig; files are named without their folders. ``files``:
            for each file ``at`` (its field in the site), ``name``, ``sha256`` (empty for a folder
            or an address) and ``beside``: name and SHA-256 of further files that belong to it.
    """
    document = site.resolved()
    files = [
        _entry([name, "file"], source.path, files_beside(source.path) if name == "dem" else ())
        for name, source in (
            ("osm", site.osm),
            ("sketch", site.sketch),
            ("dem", site.dem),
            ("corrections", site.corrections),
            ("street_objects", site.street_objects),
            ("buildings", site.buildings),
            ("roads", site.roads),
        )
        if source is not None
    ]
    for number, source in enumerate(site.geometry):
        read = geometry["sources"][number]["files"] if geometry else {}
        written = document["geometry"][number]
        if source.path is not None:
            files.append(_entry(["geometry", number, "file"], source.path) | {"beside": read})
        else:
            address = _address(["geometry", number, "url"], written)
            files.append({**address, "beside": read})
        if source.footprints is not None:
            files.append(_entry(["geometry", number, "footprints"], source.footprints))
        points = source.spec.control_points
        if isinstance(points, str):
            path = site.file.parent / points
            files.append(_entry(["geometry", number, "control_points"], path))
    for number, picture in enumerate(site.imagery):
        if picture.path is not None:
            beside = files_beside(picture.path)
            files.append(_entry(["imagery", number, "file"], picture.path, beside))
        else:
            tiles = _address(["imagery", number, "xyz"], document["imagery"][number])
            note = pictures[number] if pictures else {}
            files.append({**tiles, "pixels_sha256": note.get("pixels_sha256", "")})
    for number, (_, path) in enumerate(site.own_assets):
        files.append(_entry(["traffic", "assets", number, "file"], path, buffers_beside(path)))
    document["rig"], of_rig = rig_and_files(document["rig"], site.rig_file.parent)
    return {"site": document, "files": files + [_below("rig", entry) for entry in of_rig]}


def rig_and_files(
    rig: Mapping[str, Any], folder: Path, *, twin: Path | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return a rig whose sensors' files are named without folders, and these files.

    Args:
        rig: result of ``RigSpec.written``.
        folder: folder of the rig's file.
        twin: folder of a twin; files in it are marked as the twin's, since it is reproduced itself.
    """
    sensors, files = [], []
    for number, sensor in enumerate(rig["sensors"]):
        model, path = sensor_file(sensor["model"], folder)
        if path is None:
            sensors.append(sensor)
            continue
        sensors.append({**sensor, "model": f"{model}{path.name}"})
        pattern = pattern_beside(path)
        entry = _entry(["sensors", number, "model"], path, () if pattern is None else (pattern,))
        if twin is not None and path.resolve().parent == twin.resolve():
            entry["of"] = "twin"
        files.append(entry)
    return {**rig, "sensors": sensors}, files


def without_secrets(address: str) -> str:
    """Return an address without credentials, which manifests must not contain."""
    return _SECRET.sub("", address) if re.match("https?://", address) else address


def _entry(at: Sequence[str | int], path: Path, beside: Iterable[Path] = ()) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "at": list(at),
        "name": path.name,
        "sha256": sha256_of(path) if path.is_file() else "",
    }
    further = {path_beside.name: sha256_of(path_beside) for path_beside in beside}
    return {**entry, "beside": further} if further else entry


def _address(at: Sequence[str | int], written: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of an address, and remove credentials from the site's field."""
    field = str(at[-1])
    plain = without_secrets(written[field])
    entry: dict[str, Any] = {"at": list(at), "name": plain, "sha256": ""}
    if plain != written[field]:
        entry["shortened"] = True
    written[field] = plain
    return entry


def _below(field: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    return {**entry, "at": [field, *entry["at"]]}
