"""Coverage maps: point density of a rig on a twin."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, read_json, replaced_folder, write_json
from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.result_warning import ResultWarning, rows_of, warnings_of

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from urbantwin.interface.twin import Twin
    from urbantwin.lidar import Rig
    from urbantwin.lidar.sight import Coverage as Densities

__all__ = ["Coverage", "coverage"]

_FORM = {
    "x0": ArrayOf("f8", ()),
    "y0": ArrayOf("f8", ()),
    "cell_m": ArrayOf("f8", (), least=1e-3),
    "height_m": ArrayOf("f4", ("corners up", "corners across")),
    "semantic": ArrayOf("u2", ("rows", "columns")),
    "rate_hz": ArrayOf("f8", (), least=1e-3),
    **dict.fromkeys(("ground", "lying", "facing"), ArrayOf("f4", ("S", "rows", "columns"))),
}


class Coverage(Artefact):
    """Point density of a rig on the ground and 1 m above it.

    It can be passed as its folder.

    Attributes:
        folder: the coverage's folder.
        manifest: content of ``coverage.json``.

    Example:
        >>> coverage = ut.rig.coverage(twin)
        >>> coverage.per_frame("facing").max()
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_json(self.folder / "coverage.json", kind="coverage")
        self._on: tuple[Twin, Rig] | None = None

    @classmethod
    def open(cls, folder: AnyPath) -> Coverage:
        """Open a coverage's folder.

        Raises:
            InputError: the folder is not a coverage.
        """
        return cls(folder)

    @cached_property
    def densities(self) -> Densities:
        """Map of each sensor, points per second and square metre, and its grid of cells."""
        from urbantwin.lidar.sight import Cells
        from urbantwin.lidar.sight import Coverage as Densities

        path = self.folder / "coverage.npz"
        found = read_arrays(path, "the maps of a coverage", _FORM)
        return Densities(
            Cells(
                float(found["x0"]),
                float(found["y0"]),
                float(found["cell_m"]),
                found["height_m"],
                found["semantic"],
            ),
            tuple(self.manifest.get("sensors", ())),
            float(found["rate_hz"]),
            found["ground"],
            found["lying"],
            found["facing"],
        )

    def per_frame(self, layer: str) -> NDArray[np.float32]:
        """Return the points per frame and square metre of all sensors, (rows, columns).

        Args:
            layer: ``ground``, ``lying`` or ``facing``.
        """
        return self.densities.per_frame(layer)

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings about the sensors' positions."""
        return warnings_of(self.manifest)

    def __repr__(self) -> str:
        """Return sensors, area and folder."""
        names = ", ".join(self.manifest.get("sensors", ()))
        street = self.manifest.get("street_m2", 0.0)
        cell = self.manifest.get("cell_m", 0.0)
        return (
            f"Coverage of {street:,.0f} m2 of street by {names}, in cells of {cell:g} m "
            f"({self.folder})"
        )

    def summary(self) -> Summary:
        """Return the manifest and the warnings."""
        told = [str(one) for one in self.warnings]
        return Summary({"path": str(self.folder), **self.manifest, "warnings": told})

    def plot(self) -> Figure:
        """Draw the maps side by side; with the twin around them if just computed."""
        from urbantwin.drawing.coverage import coverage_figure
        from urbantwin.drawing.pictures import figure_of_coverage

        if self._on is None:
            return coverage_figure(self.densities)
        twin, rig = self._on
        return figure_of_coverage(self.densities, rig, twin)

    def _of(self, twin: Twin, rig: Rig) -> Coverage:
        self._on = (twin, rig)
        return self


@command
def coverage(
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    rig: AnyPath | None = None,
    cell: float = 0.5,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Coverage:
    """Map the points per square metre that a rig gets.

    The maps are for the ground and for 1 m above it.

    Args:
        twin: twin, or its folder.
        out: folder to write; ``coverage`` beside the twin if not given.
        rig: ``rig.yaml``; the twin's own rig if not given.
        cell: side of a cell of the map, metres.
        pictures: draw the maps into the folder.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the twin or the rig cannot be used, or ``out`` holds other files.

    Example:
        $ urbantwin rig coverage urbantwin-demo/twin -o coverage/
    """
    from urbantwin.drawing.pictures import picture_of_coverage
    from urbantwin.interface.rig import rig_on
    from urbantwin.interface.twin import Twin
    from urbantwin.lidar.sight import rig_coverage, sight_of_rig

    place = beside(twin, "coverage", out)
    rig_file = None if rig is None else Path(rig)
    inputs = [Path(twin), rig_file]
    check_folder(place, kind="coverage", inputs=inputs)
    loaded = Twin.open(twin)
    placed = rig_on(loaded, rig_file)
    with replaced_folder(place, kind="coverage", inputs=inputs) as folder:
        with shown_stage("coverage", progress) as tell:
            found = rig_coverage(
                placed,
                loaded.mesh,
                loaded.region.bounds,
                cell_m=cell,
                surface=loaded.surface_materials,
                progress=tell,
            )
            found.save(folder / "coverage.npz")
        sight = sight_of_rig(placed, loaded.roads, loaded.region, loaded.mesh)
        summary = {
            "kind": "coverage",
            "twin_sha256": loaded.sha256,
            "sensors": list(found.sensors),
            "rate_hz": found.rate_hz,
            "cell_m": cell,
            "unit": "points per square metre and frame",
            **found.summary(loaded.region),
            **({} if sight is None else {"sight": sight.notes()}),
            "warnings": rows_of(() if sight is None else sight.warnings()),
        }
        write_json(folder / "coverage.json", summary)
        if pictures:
            picture_of_coverage(found, placed, loaded, folder / "coverage.png")
    made = Coverage(place)
    tell_result("coverage", place, made.warnings, progress)
    return made._of(loaded, placed)
