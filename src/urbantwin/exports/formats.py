"""Export formats of twins."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact import check_file, check_folder
from urbantwin.errors import InputError
from urbantwin.exports.carla import write_carla
from urbantwin.exports.geojson import write_geojson
from urbantwin.exports.plan_sheet import write_plan
from urbantwin.exports.scene import write_scene
from urbantwin.exports.sumo import write_sumo
from urbantwin.roads.opendrive import VERSIONS, write_opendrive
from urbantwin.twin import Twin

__all__ = ["FORMATS", "Exported", "Format", "export_twin", "format_named"]


@dataclass(frozen=True)
class Format:
    """An export format.

    Attributes:
        name: name of the format.
        ending: suffix of the file's name; empty for a folder.
        versions: versions of the format's standard, the default first.
        files: suffixes written as files, for a format that otherwise writes a folder.
        write: function of twin, path and version that writes atomically and returns notes for the
            user.
    """

    name: str
    ending: str
    versions: tuple[str, ...]
    write: Callable[[Twin, Path, str], Sequence[str] | None]
    files: tuple[str, ...] = ()

    def is_file(self, path: Path) -> bool:
        """Return whether the format is written to a path as a file."""
        return bool(self.ending and not self.files) or path.suffix.lower() in self.files


@dataclass(frozen=True)
class Exported:
    """A written export, with notes for the user."""

    path: Path
    notes: tuple[str, ...] = ()


def _opendrive(twin: Twin, path: Path, version: str) -> None:
    name = str(twin.manifest["name"])
    write_opendrive(twin.lane_model, twin.frame, path, version=version, name=name)


def _scene(name: str, ending: str) -> Format:
    return Format(name, ending, (), lambda twin, path, _: write_scene(twin, path, name))


FORMATS: Mapping[str, Format] = {
    entry.name: entry
    for entry in (
        Format("opendrive", ".xodr", VERSIONS, _opendrive),
        Format(
            "geojson",
            ".geojson",
            (),
            lambda twin, path, _: write_geojson(twin, path),
            (".geojson", ".json"),
        ),
        Format("sumo", "", (), lambda twin, path, _: write_sumo(twin, path)),
        Format("carla", "", (), lambda twin, path, _: write_carla(twin, path)),
        Format("plan", "", (), lambda twin, path, _: write_plan(twin, path), (".svg", ".png")),
        _scene("glb", ".glb"),
        _scene("obj", ".obj"),
        _scene("ply", ".ply"),
        _scene("usd", ".usd"),
        _scene("fbx", ".fbx"),
        _scene("cityjson", ".city.json"),
    )
}


def format_named(name: str) -> Format:
    """Return a format.

    Raises:
        InputError: the name is unknown.
    """
    if name not in FORMATS:
        raise InputError(
            f"{name!r} is not a format", place="--to", expected=f"one of {', '.join(FORMATS)}"
        )
    return FORMATS[name]


def export_twin(
    twin: Twin, name: str, out: Path | None = None, *, version: str | None = None
) -> Exported:
    """Write a twin in another format, atomically.

    Args:
        twin: the twin.
        name: the format.
        out: file or folder to write; if not given, named after the twin, in the current folder.
        version: version of the format's standard, if it has versions.

    Raises:
        InputError: the format, the version or ``out`` cannot be used.
    """
    wanted = format_named(name)
    if version is not None and version not in wanted.versions:
        raise InputError(
            f"{name} has no version {version!r}",
            place="--version",
            expected=f"one of {', '.join(wanted.versions)}" if wanted.versions else "none",
        )
    path = out or Path(f"{_file_name(str(twin.manifest['name']))}{wanted.ending or '-' + name}")
    if wanted.is_file(path):
        check_file(path, kind=name, inputs=[twin.folder])
    else:
        check_folder(path, kind=name, inputs=[twin.folder])
    notes = wanted.write(twin, path, version or next(iter(wanted.versions), ""))
    return Exported(path, tuple(notes or ()))


def _file_name(name: str) -> str:
    """Return a name without characters that file systems reject: "A / B" becomes "A-B"."""
    return re.sub(r'[\s/\\:*?"<>|]*[/\\:*?"<>|\x00-\x1f]+\s*', "-", name).strip(" .-") or "twin"
