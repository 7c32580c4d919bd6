"""``compare``: real frames against synthetic frames of the same place, as a report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.fidelity import histograms as bins
from urbantwin.fidelity import surface
from urbantwin.fidelity.clouds import Cloud, cloud_files, read_cloud
from urbantwin.fidelity.histograms import Histograms
from urbantwin.fidelity.measure import RealFrame
from urbantwin.fidelity.point_to_mesh import MAX_POINTS
from urbantwin.fidelity.report import FrameFigures, Report, aggregate, reduction_percent

__all__ = ["compare"]

Progress = Callable[[float, str], None]

#: Share of the work that reading every cloud once, to check it, takes.
_SURVEY = 0.05


@dataclass(frozen=True)
class _Folder:
    """The clouds of one side that are compared, and the full scale of their intensity."""

    files: list[Path]
    columns: int | None
    scale: float | None

    def read(self, index: int) -> Cloud:
        return read_cloud(self.files[index], self.columns)


def compare(
    real: Path,
    synthetic: Path,
    out: Path,
    *,
    arbitrary: Path | None = None,
    columns: int | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    progress: Progress | None = None,
) -> Report:
    """Compare two folders of clouds in the same frame and write ``report.json``, ``report.png``.

    Frames are paired in the order of their names (numbers by value): the i-th real with the
    i-th synthetic one. The longer folder's further frames are left out, and the report says so.

    Args:
        real: a folder of real clouds (npy, bin, pcd, ply).
        synthetic: a folder of synthetic clouds of the same place, or one of our datasets.
        out: the report's folder; an older report there is replaced.
        arbitrary: synthetic clouds of some other place: the control that the twin is measured
            beside.
        columns: values per row of ``.bin`` files, where it is neither 4 nor 3.
        origin: (3,) the sensor's place in the frame of the clouds, metres: where ranges and the
            rebuilt surface are seen from.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: a folder or a cloud is not what it should be, or ``out`` holds other files.
    """
    tell = progress or (lambda fraction, what: None)
    place = np.asarray(origin, np.float64).reshape(3)
    paths = {"real": real, "synthetic": synthetic}
    if arbitrary is not None:
        paths["arbitrary"] = arbitrary
    listed = {side: cloud_files(path) for side, path in paths.items()}
    count = min(len(listed["real"]), len(listed["synthetic"]))

    with replaced_folder(out, kind="report") as folder:
        sides = _survey(listed, count, columns, tell)
        frames, pooled, sample = _measure(sides, count, place, tell)
        report = _report(paths, listed, sides, frames, place)
        write_json(folder / "report.json", report.as_json())
        tell(0.98, "drawing the report")
        from urbantwin.fidelity.figure import draw_report

        draw_report(report, pooled, sample, folder / "report.png")
    tell(1.0, "compared")
    return report


def _survey(
    listed: dict[str, list[Path]], count: int, columns: int | None, tell: Progress
) -> dict[str, _Folder]:
    """Read every cloud that will be compared once: a bad one is named before the long work."""
    # One real frame more than pairs: the last one's neighbour.
    used = {
        side: files[: count + 1] if side == "real" else files[:count]
        for side, files in listed.items()
    }
    total, done = sum(len(files) for files in used.values()), 0
    sides = {}
    for side, files in used.items():
        largest: float | None = 0.0
        for file in files:
            tell(_SURVEY * done / total, "checking the clouds")
            cloud = read_cloud(file, columns)
            if cloud.intensity is None or largest is None:
                largest = None
            else:
                largest = max(largest, float(cloud.intensity.max()))
            done += 1
        sides[side] = _Folder(files, columns, None if largest is None else bins.full_scale(largest))
    return sides


def _measure(
    sides: dict[str, _Folder], count: int, origin: NDArray[np.float64], tell: Progress
) -> tuple[list[FrameFigures], dict[str, dict[str, NDArray[np.float64]]], dict[str, Cloud]]:
    """Measure every pair; pool the histograms for the figure and keep its first frame."""
    real, synthetic, arbitrary = sides["real"], sides["synthetic"], sides.get("arbitrary")
    frames: list[FrameFigures] = []
    pooled: dict[str, dict[str, NDArray[np.float64]]] = {}
    sample: dict[str, Cloud] = {}
    following = real.read(0)
    for index in range(count):
        tell(_SURVEY + (0.97 - _SURVEY) * index / count, f"comparing frame {index + 1} of {count}")
        clouds = {"real": following, "synthetic": synthetic.read(index)}
        frame = RealFrame(clouds["real"], intensity_scale=real.scale, origin=origin)
        _pool(pooled, "real", frame.histograms)
        twin_figures, theirs = frame.measure(clouds["synthetic"], intensity_scale=synthetic.scale)
        _pool(pooled, "synthetic", theirs)

        arbitrary_figures = None
        if arbitrary is not None and index < len(arbitrary.files):
            clouds["arbitrary"] = arbitrary.read(index)
            arbitrary_figures, theirs = frame.measure(
                clouds["arbitrary"], intensity_scale=arbitrary.scale
            )
            _pool(pooled, "arbitrary", theirs)
        real_figures = None
        if index + 1 < len(real.files):
            following = real.read(index + 1)
            real_figures, _ = frame.measure(following, intensity_scale=real.scale)

        sample = sample or clouds
        error = frame.surface.rebuild_error
        frames.append(
            FrameFigures(
                real=real.files[index].name,
                synthetic=synthetic.files[index].name,
                arbitrary=arbitrary.files[index].name if arbitrary and arbitrary_figures else None,
                points={
                    side: {
                        "compared": len(cloud.points),
                        "not_finite": cloud.not_finite,
                        "no_return": cloud.no_return,
                    }
                    for side, cloud in clouds.items()
                },
                twin_figures=twin_figures,
                arbitrary_figures=arbitrary_figures,
                real_figures=real_figures,
                rebuild={
                    "triangles": frame.surface.surface.triangles,
                    "covered": frame.surface.surface.covered,
                    "held_out_mean_m": error.mean if error else None,
                    "held_out_median_m": error.median if error else None,
                    "held_out_p95_m": error.p95 if error else None,
                },
            )
        )
    return frames, pooled, sample


def _pool(pooled: dict[str, dict[str, NDArray[np.float64]]], side: str, found: Histograms) -> None:
    mine = pooled.setdefault(side, {})
    for name, counts in found.binned.items():
        mine[name] = mine.get(name, np.zeros_like(counts)) + counts


def _report(
    paths: dict[str, Path],
    listed: dict[str, list[Path]],
    sides: dict[str, _Folder],
    frames: list[FrameFigures],
    origin: NDArray[np.float64],
) -> Report:
    twin = [frame.twin_figures for frame in frames]
    control = [f.arbitrary_figures for f in frames if f.arbitrary_figures is not None]
    neighbours = [f.real_figures for f in frames if f.real_figures is not None]
    return Report(
        folders={
            side: {
                "name": path.resolve().name,
                "clouds": len(listed[side]),
                "compared": min(len(listed[side]), len(frames)),
                "intensity_full_scale": sides[side].scale,
            }
            for side, path in paths.items()
        },
        frames=frames,
        twin=aggregate(twin),
        real_against_real=aggregate(neighbours) if neighbours else None,
        arbitrary=aggregate(control) if control else None,
        reduction_percent=reduction_percent(twin, control) if control else None,
        parameters={
            "origin_m": origin.tolist(),
            "voxel_m": bins.VOXEL_M,
            "bins": {
                "range_m": _bins(bins.RANGE_EDGES_M),
                "height_m": _bins(bins.HEIGHT_EDGES_M),
                "intensity": _bins(bins.INTENSITY_EDGES),
                "density_m": _bins(bins.DENSITY_EDGES_M),
            },
            "surface": {
                "max_edge_m": surface.MAX_EDGE_M,
                "max_angle_deg": surface.MAX_ANGLE_DEG,
                "min_grazing_deg": surface.MIN_GRAZING_DEG,
                "level_deg": surface.LEVEL_DEG,
                "max_points": MAX_POINTS,
            },
        },
        notes=_notes(listed, sides, frames),
    )


def _bins(edges: NDArray[np.float64]) -> dict[str, Any]:
    return {"from": float(edges[0]), "to": float(edges[-1]), "count": len(edges) - 1}


def _notes(
    listed: dict[str, list[Path]], sides: dict[str, _Folder], frames: Sequence[FrameFigures]
) -> list[str]:
    """Say what a reader of the figures must know about the input."""
    notes = ["Frames are paired in the order of their names: the i-th with the i-th."]
    for side, files in listed.items():
        if len(files) > len(frames):
            notes.append(f"{side}: {len(files) - len(frames)} further clouds have no partner.")
        elif len(files) < len(frames):
            notes.append(f"{side}: only {len(files)} clouds for {len(frames)} pairs.")
        for reason, text in (
            ("not_finite", "points with a NaN or infinite value"),
            ("no_return", "points at exactly (0, 0, 0), beams without a return,"),
        ):
            lost = sum(frame.points.get(side, {}).get(reason, 0) for frame in frames)
            if lost:
                notes.append(f"{side}: {lost} {text} are left out.")
        if sides[side].scale is None:
            notes.append(f"{side}: has no intensity in every cloud: it is not compared.")
    if len(listed["real"]) < 2:
        notes.append("A single real frame: there is no real against real.")
    return notes
