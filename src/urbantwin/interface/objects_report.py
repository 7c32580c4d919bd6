"""Our bodies in the boxes of real objects: a report, opened."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import read_json
from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ObjectsReport"]


class ObjectsReport(Artefact):
    """What `compare` found of our bodies in the boxes of labelled real frames.

    ``objects.html`` in its folder is the page for people.

    Attributes:
        folder: where it is.
        manifest: ``objects.json``.

    Example:
        >>> report = ut.compare("kitti/training", objects=True)
        >>> [(row["class"], row["points_ratio"]) for row in report.figures]
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_json(self.folder / "objects.json", kind="objects")
        missing = {"figures", "objects", "in_short", "definitions"} - set(self.manifest)
        if missing:
            raise InputError(
                f"lacks {', '.join(sorted(missing))}",
                file=self.folder / "objects.json",
                expected="a report of objects",
            )

    @classmethod
    def open(cls, folder: AnyPath) -> ObjectsReport:
        """Open a report's folder.

        Raises:
            InputError: it is not a report of objects, or lacks figures.
        """
        return cls(folder)

    @property
    def figures(self) -> list[dict[str, Any]]:
        """A row for each class at all distances, and for each class of distance."""
        return list(self.manifest["figures"])

    @property
    def objects(self) -> list[dict[str, Any]]:
        """Every object: its box, our body, points and distances."""
        return list(self.manifest["objects"])

    @property
    def definitions(self) -> dict[str, str]:
        """What each figure is."""
        return dict(self.manifest["definitions"])

    def __repr__(self) -> str:
        """Return the headline and the folder."""
        return f"ObjectsReport ({self.folder}). {self.manifest['in_short']}"

    def summary(self) -> Summary:
        """Return the figures of every class in a few values."""
        return Summary(
            path=str(self.folder),
            kind="objects",
            in_short=self.manifest["in_short"],
            figures=[_told(row) for row in self.figures],
            problems=self.manifest.get("problems", []),
            notes=self.manifest.get("notes", []),
        )

    def plot(self) -> Figure:
        """Show the report's picture."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.folder / "objects.png")


def _told(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with pairs as texts, without what is not known."""
    return {
        name: f"{value['real']:g} / {value['ours']:g}" if isinstance(value, dict) else value
        for name, value in row.items()
        if value is not None
    }
