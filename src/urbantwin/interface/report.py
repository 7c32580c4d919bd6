"""Reports that compare real with synthetic frames."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from annotated_types import Ge
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact import read_json
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Report", "compare"]

#: Sides of a figure, and their names per frame in ``report.json``.
_SIDES = {
    "synthetic": "twin_figures",
    "next_real": "real_figures",
    "arbitrary": "arbitrary_figures",
}


class Report(Artefact):
    """Result of a comparison: figures of every measure, with their anchors.

    Sides are ``synthetic`` (against the real frames), ``next_real`` (each real frame against the
    next) and ``arbitrary`` (the control's against the real frames). It can be passed as its folder;
    ``report.html`` in it is the report page.

    Attributes:
        folder: the report's folder.
        manifest: content of ``report.json``.

    Example:
        >>> report = ut.open("out/report")
        >>> report.means["hausdorff_p95_m"]["synthetic"]
        >>> report.figures("chamfer_m").mean()
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_json(self.folder / "report.json", kind="report")
        self._told = self._summed_up()

    @classmethod
    def open(cls, folder: AnyPath) -> Report:
        """Open a report's folder.

        Raises:
            InputError: the folder is not a report, or figures are missing.
        """
        return cls(folder)

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures; see `definitions`."""
        return tuple(self.manifest["definitions"])

    @property
    def definitions(self) -> dict[str, Any]:
        """Definition of each measure, with unit and source."""
        return dict(self.manifest["definitions"])

    @cached_property
    def means(self) -> dict[str, dict[str, float]]:
        """Means over frames, by measure and side; a side that was not measured is omitted."""
        columns = self._columns()
        return {
            measure: {
                side: float(column[measure]["mean"])
                for side, column in columns.items()
                if column and column.get(measure)
            }
            for measure in self.measures
        }

    def figures(self, measure: str, side: str = "synthetic") -> NDArray[np.float64]:
        """Return the figure (F,) of a measure in every pair of frames; nan if undefined.

        Raises:
            InputError: the measure or side is unknown.
        """
        if measure not in self.measures or side not in _SIDES:
            raise InputError(
                f"has no {measure} of {side}",
                file=self.folder,
                expected=f"one of {', '.join(self.measures)}; of {', '.join(_SIDES)}",
            )
        rows = (one.get(_SIDES[side]) or {} for one in self.manifest["frames"])
        found = (row.get(measure) for row in rows)
        return np.array([np.nan if one is None else one for one in found], np.float64)

    def __repr__(self) -> str:
        """Return the sides, the headline and the folder."""
        frames = len(self.manifest["frames"])
        told = self._told["in_short"] or ""
        text = told if isinstance(told, str) else " ".join(map(str, told))
        return f"Report of {frames} pairs of frames ({self.folder}). {text}".rstrip()

    def summary(self) -> Summary:
        """Return the main figures."""
        return Summary(self._told)

    def plot(self) -> Figure:
        """Draw every measure of every side."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.folder / "report.png")

    def _columns(self) -> dict[str, Any]:
        anchors = self.manifest["anchors"]
        return {
            "synthetic": self.manifest["aggregate"],
            "next_real": anchors["real_against_real"],
            "arbitrary": anchors["arbitrary"],
        }

    def _summed_up(self) -> Summary:
        manifest = self.manifest
        try:
            anchors = manifest["anchors"]
            return Summary(
                path=str(self.folder),
                kind="report",
                in_short=manifest.get("in_short"),
                doubts=manifest.get("doubts", []),
                folders=manifest["folders"],
                frames=len(manifest["frames"]),
                mean_over_frames={
                    measure: {
                        name: round(column[measure]["mean"], 4)
                        for name, column in self._columns().items()
                        if column and column.get(measure)
                    }
                    for measure in manifest["definitions"]
                },
                reduction_percent=_rounded(anchors["reduction_percent"], 1),
                ratio_to_real=_rounded(anchors.get("ratio_to_real"), 2),
                parts={
                    part: _rounded({measure: row["twin"] for measure, row in rows.items()}, 4)
                    for part, rows in manifest.get("headline", {}).items()
                    if part != "whole"
                },
                foreground_objects=manifest.get("foreground_objects"),
                protocol=_scores(manifest.get("protocol")),
                problems=manifest.get("problems", []),
                notes=manifest["notes"],
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"lacks {error}", file=self.folder / "report.json", expected="a report's figures"
            ) from None


@command
def compare(
    real: AnyPath,
    dataset: AnyPath,
    out: AnyPath | None = None,
    *,
    arbitrary: AnyPath | None = None,
    anchor: AnyPath | None = None,
    within: Annotated[tuple[float, float, float] | ArrayLike | None, "X Y Z"] = None,
    layout: str | None = None,
    columns: Annotated[int | None, Ge(3)] = None,
    origin: Annotated[tuple[float, float, float] | ArrayLike | None, "X Y Z"] = None,
    protocol: str | None = None,
    detections: AnyPath | None = None,
    workers: Annotated[int | None, Ge(1)] = None,
    progress: ShowProgress = True,
) -> Report:
    """Measure simulated frames against real ones.

    Args:
        real: real frames: clouds, a dataset in a known layout, a ROS bag or MCAP, or a capture of
            packets.
        dataset: dataset, or folder of clouds in the same frame.
        out: folder to write, in which an older report is replaced; ``report`` beside the dataset
            if not given.
        arbitrary: clouds of another site, measured alike as a control; ``none`` for no control; an
            example site, recorded by the dataset's sensors, if not given.
        anchor: other real frames of the place, for real against real; each frame's neighbour if not
            given.
        within: half extents of the box about the frame's origin that all sides are cropped to,
            metres.
        layout: layout of the real frames; recognised from their files if not given.
        columns: values per row of ``.bin`` files; 4 if not given.
        origin: position of the sensor in the clouds' frame, metres; as the data says if not given.
        protocol: protocol of a challenge to compute as well: ``urbantwin-challenge``.
        detections: detections in the real frames, for the protocol.
        workers: number of processes; every number gives the same bytes.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: a side cannot be read, or ``out`` holds other files.
        StageError: a worker was killed.

    Example:
        >>> report = ut.compare("real/", dataset)
        >>> report.means["js_mean"]
        $ urbantwin compare real/ urbantwin-demo/dataset -o report/
    """
    from urbantwin.fidelity.compare import compare as compare_frames

    place = beside(dataset, "report", out)
    control: Path | Literal["example"] | None = "example" if arbitrary is None else Path(arbitrary)
    if control == Path("none"):
        control = None
    with shown_stage("compare", progress) as tell:
        compare_frames(
            Path(real),
            Path(dataset),
            place,
            arbitrary=control,
            anchor=None if anchor is None else Path(anchor),
            within=within,
            columns=columns,
            layout=layout,
            origin=origin,
            protocol=protocol,
            detections=None if detections is None else Path(detections),
            workers=workers,
            progress=tell,
        )
    return Report(place)


def _scores(protocol: dict[str, Any] | None) -> dict[str, Any] | None:
    if not protocol:
        return None
    return {
        name: {
            part: round(row[part], 4)
            for part in ("combined", "detection", "realism")
            if row[part] is not None
        }
        for name, row in protocol["scores"].items()
    }


def _rounded(
    values: Mapping[str, float | None] | None, digits: int
) -> dict[str, float | None] | None:
    """Return rounded values for printing; ``report.json`` has all digits."""
    if values is None:
        return None
    return {name: None if value is None else round(value, digits) for name, value in values.items()}
