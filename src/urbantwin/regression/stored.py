"""What was accepted of a suite: a folder with what is kept of each motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact import read_json, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.regression.motion_print import MotionPrint

__all__ = ["Stored"]


@dataclass(frozen=True)
class Stored:
    """What was accepted.

    Attributes:
        folder: where it is.
        manifest: ``suite.json``: versions, the twin's hash and, by their keys, the cases.
    """

    folder: Path
    manifest: dict[str, Any]

    @classmethod
    def open(cls, folder: Path) -> Stored:
        """Open a folder; one that is not there holds no case.

        Raises:
            InputError: it is something else.
        """
        file = folder / "suite.json"
        if not file.is_file():
            return cls(folder, {"cases": {}})
        manifest = read_json(file, kind="suite")
        if manifest.get("kind") != "suite" or not isinstance(manifest.get("cases"), dict):
            raise InputError("is not what a suite accepted", file=file, expected='"kind": "suite"')
        return cls(folder, manifest)

    def of(self, key: str) -> MotionPrint | None:
        """Return what was accepted of a case; ``None`` where nothing was.

        Raises:
            InputError: it is damaged.
        """
        told = self.manifest["cases"].get(key)
        return None if told is None else MotionPrint.read(self.folder / f"{key}.parquet", told)

    def differs(self, made_with: Mapping[str, Any]) -> list[str]:
        """Return in what the makers differ: program, SUMO, twin."""
        before = self.manifest.get("made_with")
        if before is None:
            return []
        return [
            f"{name}: {before.get(name)} before, {value} now"
            for name, value in made_with.items()
            if before.get(name) != value
        ]

    @classmethod
    def write(
        cls, folder: Path, prints: Mapping[str, MotionPrint], made_with: Mapping[str, Any]
    ) -> Stored:
        """Store cases in place of what was accepted before."""
        manifest = {
            "kind": "suite",
            "version": 1,
            "urbantwin": __version__,
            "made_with": dict(made_with),
            "cases": {key: one.told for key, one in prints.items()},
        }
        with replaced_folder(folder, kind="suite") as scratch:
            for key, one in prints.items():
                one.write(scratch / f"{key}.parquet")
            write_json(scratch / "suite.json", manifest)
        return cls(folder, manifest)
