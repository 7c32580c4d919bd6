"""The sets of pictures: of a twin, and of a recorded dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.dataset import parts_of
from urbantwin.dataset.manifest_schema import read_manifest
from urbantwin.dataset.motion_interpolation import Rows, rows_at
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Rig
from urbantwin.lidar.coverage import Coverage
from urbantwin.progress import Progress, untold
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset_mesh
from urbantwin.twin import Twin
from urbantwin.view.birdseye import birdseye
from urbantwin.view.coverage import coverage_picture
from urbantwin.view.ground_materials import ground_picture
from urbantwin.view.histogram import histogram
from urbantwin.view.labelled_frame import read_labelled_points
from urbantwin.view.plan import plan
from urbantwin.view.range_image import range_image
from urbantwin.view.scene import scene_picture
from urbantwin.view.style import legible

__all__ = [
    "actor_meshes",
    "attributions",
    "picture_of_coverage",
    "pictures_of_dataset",
    "pictures_of_twin",
    "title_of",
]


def pictures_of_twin(twin: Twin, out: Path, *, progress: Progress | None = None) -> list[Path]:
    """Draw a twin into ``out``: ``plan.png``, ``scene.png`` and, of imagery, ``ground.png``.

    Args:
        twin: the twin.
        out: the folder, made if it is not there; pictures of these names are replaced.
        progress: called with the fraction done and what is being done.
    """
    tell = progress or untold
    out.mkdir(parents=True, exist_ok=True)
    name = title_of(twin)
    sources = attributions(twin.manifest)
    tell(0.0, "drawing the plan")
    sensors = twin.rig_spec().standing()
    first = plan(
        twin.roads,
        twin.region,
        out / "plan.png",
        model=twin.lane_model,
        mesh=twin.mesh,
        sensors=sensors,
        title=name,
        attribution=sources,
    )
    tell(0.2, "drawing the scene")
    second = scene_picture(
        twin.mesh,
        out / "scene.png",
        title=name,
        below=_size(twin),
        attribution=sources,
        surface=twin.surface_materials,
    )
    drawn = [first, second]
    if twin.site.get("imagery"):
        tell(0.9, "drawing the ground")
        drawn.append(
            ground_picture(
                twin.mesh,
                twin.surface_materials,
                twin.region,
                out / "ground.png",
                title=f"{name}   materials of the ground",
                attribution=sources,
            )
        )
    tell(1.0, "drawn")
    return drawn


def pictures_of_dataset(
    dataset: Path,
    out: Path | None = None,
    *,
    twin: Twin | None = None,
    motion: Motion | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Draw a recorded dataset: the frame with the most labelled actors, and its classes.

    ``birdseye.png``, ``range_image.png``, ``histogram.png``, and, where the twin and its motion
    are given, ``scene.png``: the same moment in the twin with its actors. In a folder with a
    dataset for each sensor, those of all.

    Args:
        dataset: the dataset's folder.
        out: where to; without it the dataset's ``pictures/``.
        twin: the twin that it was recorded in.
        motion: the motion that it was recorded from.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: there is no dataset, or a file of it is missing.
    """
    tell = progress or untold
    parts = parts_of(dataset)
    if parts != [dataset]:
        drawn = []
        for part in parts:
            own = None if out is None else out / part.name
            drawn += pictures_of_dataset(part, own, twin=twin, motion=motion, progress=progress)
        return drawn
    manifest = read_manifest(dataset)
    counts = manifest["counts"]
    points, boxes = counts["points_by_class"], counts["boxes"]
    with_points, frames = counts["boxes_with_points"], counts["frames"]
    sources = attributions(manifest)
    frame = read_labelled_points(dataset)
    out = dataset / "pictures" if out is None else out
    out.mkdir(parents=True, exist_ok=True)

    tell(0.0, "drawing the bird's-eye view")
    drawn = [birdseye(frame, out / "birdseye.png", attribution=sources)]
    tell(0.25, "drawing the range image")
    sensor = 0
    if frame.sensor is not None and len(frame.sensor):
        sensor = int(frame.sensor[len(frame.sensor) // 2])
    if len(frame.points):
        drawn.append(
            range_image(frame, out / "range_image.png", sensor=sensor, attribution=sources)
        )
    tell(0.5, "drawing the histogram")
    drawn.append(
        histogram(
            points,
            boxes,
            with_points,
            out / "histogram.png",
            below=f"{frames:,} frame{'' if frames == 1 else 's'}   {sum(points.values()):,} points",
            attribution=sources,
        )
    )
    if twin is not None and motion is not None:
        tell(0.6, "drawing the scene")
        meshes = [twin.mesh, *actor_meshes(rows_at(motion, frame.time_s))]
        drawn.append(
            scene_picture(
                LabelledMesh.concatenate(meshes),
                out / "scene.png",
                title=title_of(twin),
                below=f"frame {frame.name}   {frame.time_s:.1f} s",
                attribution=sources,
                surface=twin.surface_materials,
            )
        )
    tell(1.0, "drawn")
    return drawn


def picture_of_coverage(coverage: Coverage, rig: Rig, twin: Twin, path: Path) -> Path:
    """Draw where a rig on a twin sees how much.

    Args:
        coverage: of the rig.
        rig: its sensors.
        twin: where it stands.
        path: the PNG to write.
    """
    places = [one.site_SE3_sensor.translation for one in rig.sensors]
    return coverage_picture(
        coverage,
        path,
        sensors=[
            (one.name, float(x), float(y))
            for one, (x, y, _) in zip(rig.sensors, places, strict=True)
        ],
        mesh=twin.mesh,
        roads=twin.roads,
        region=twin.region,
        title=title_of(twin),
        attribution=attributions(twin.manifest),
    )


def actor_meshes(rows: Rows) -> list[LabelledMesh]:
    """Return the posed meshes of the actors at one moment, their track as ``part``."""
    meshes = []
    for row in rows:
        pose = Pose.from_ypr([row["x"], row["y"], row["z"]], row["yaw"], row["pitch"], row["roll"])
        mesh = asset_mesh(str(row["asset"]), int(row["phase"])).transformed(pose)
        meshes.append(
            LabelledMesh.build(
                mesh.vertices, mesh.faces, mesh.semantic, mesh.material, int(row["track"])
            )
        )
    return meshes


def title_of(twin: Twin) -> str:
    """Return the twin's name, or where it is if the name cannot be written."""
    where = f"{abs(twin.frame.latitude):.4f}° {'N' if twin.frame.latitude >= 0 else 'S'}, "
    where += f"{abs(twin.frame.longitude):.4f}° {'E' if twin.frame.longitude >= 0 else 'W'}"
    return legible(str(twin.manifest.get("name") or "")) or f"Intersection at {where}"


def attributions(manifest: dict[str, Any]) -> list[str]:
    """Return whose data an artefact was made from, each once."""
    found = [str(one.get("attribution") or "") for one in manifest.get("inputs", [])]
    return [one for one in dict.fromkeys(found) if one not in ("", "not stated")]


def _size(twin: Twin) -> str:
    x0, y0, x1, y1 = twin.region.bounds
    triangles = len(twin.mesh.faces)
    return f"{x1 - x0:.0f} x {y1 - y0:.0f} m   {triangles:,} triangles"
