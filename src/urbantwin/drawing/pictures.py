"""The sets of pictures: of a twin, and of a recorded dataset."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from urbantwin.dataset import parts_of
from urbantwin.dataset.card import PICTURE_OF_SPLIT, read_statistics
from urbantwin.dataset.motion_interpolation import Rows, rows_at
from urbantwin.dataset.reading import Fleet
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.dataset.split import image_sets
from urbantwin.drawing import style
from urbantwin.drawing.birdseye import birdseye_figure
from urbantwin.drawing.box_figures import picture_of_split, pictures_of_boxes
from urbantwin.drawing.coverage import coverage_figure
from urbantwin.drawing.event_picture import event_figure
from urbantwin.drawing.fleet import figure_of_fleet
from urbantwin.drawing.ground_materials import ground_figure
from urbantwin.drawing.histogram import histogram_figure
from urbantwin.drawing.labelled_frame import LabelledPoints, read_labelled_points
from urbantwin.drawing.paths import paths_figure
from urbantwin.drawing.plan import plan_figure
from urbantwin.drawing.range_image import range_image_figure
from urbantwin.drawing.scene import scene_figure
from urbantwin.drawing.sight import sight_figure
from urbantwin.drawing.style import legible
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Rig, place_rig
from urbantwin.lidar.sight import Coverage, RigSight, sight_of_rig
from urbantwin.processes import begun
from urbantwin.progress import Progress, between, untold
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset_mesh
from urbantwin.twin import Twin, load_twin

__all__ = [
    "actor_meshes",
    "attributions",
    "figure_of_coverage",
    "figure_of_dataset",
    "figure_of_motion",
    "figure_of_twin",
    "picture_of_coverage",
    "picture_of_fleet",
    "picture_of_motion",
    "pictures_of_dataset",
    "pictures_of_events",
    "pictures_of_twin",
    "redraw_split",
    "sight_on",
    "title_of",
]


def pictures_of_twin(
    twin: Twin,
    out: Path,
    *,
    pool: ProcessPoolExecutor | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Draw a twin into ``out``: ``plan.png``, ``scene.png`` and, if possible, the others.

    ``sight.png`` requires a fixed rig, ``ground.png`` imagery.

    Args:
        twin: the twin.
        out: the folder, created if missing; pictures with these names are replaced.
        pool: helper processes, which draw the scene while this process draws the plan.
        progress: called with the share done and the current task.
    """
    tell = progress or untold
    out.mkdir(parents=True, exist_ok=True)
    with begun(pool, _picture_of_opened, twin.folder, out) as of_scene:
        tell(0.0, "drawing the plan")
        plan = figure_of_twin(twin, "plan")
        tell(0.2, "drawing the plan")
        drawn = [style.save(plan, out / "plan.png")]
        sight = sight_on(twin)
        if sight is not None:
            tell(0.3, "drawing what the sensors see")
            drawn.append(style.save(_figure_of_sight(twin, sight), out / "sight.png"))
        tell(0.5, "drawing the scene")
        if pool is None:
            drawn.append(_picture_of_scene(twin, out, between(tell, 0.5, 0.9)))
        else:
            drawn.append(of_scene())
    if twin.site.get("imagery"):
        tell(0.9, "drawing the ground")
        drawn.append(style.save(figure_of_twin(twin, "ground"), out / "ground.png"))
    tell(1.0, "drawn")
    return drawn


def _picture_of_opened(folder: Path, out: Path) -> Path:
    """Draw the scene of the twin in a folder into ``out``."""
    return _picture_of_scene(load_twin(folder), out, untold)


def _picture_of_scene(twin: Twin, out: Path, tell: Progress) -> Path:
    """Draw the scene of a twin into ``out``."""
    return style.save(_figure_of_scene(twin, tell), out / "scene.png")


def _figure_of_scene(twin: Twin, tell: Progress = untold) -> Figure:
    return scene_figure(
        twin.mesh,
        title=title_of(twin),
        below=_size(twin),
        attribution=attributions(twin.manifest),
        surface=twin.surface_materials,
        colours=twin.colours,
        tell=tell,
    )


def figure_of_twin(twin: Twin, picture: str) -> Figure:
    """Draw a twin.

    Args:
        twin: the twin.
        picture: ``plan``, ``sight`` (the field of view of the sensors), ``scene`` or ``ground``.

    Raises:
        InputError: there is no such picture.
    """
    name, sources = title_of(twin), attributions(twin.manifest)
    if picture == "plan":
        return plan_figure(
            twin.roads,
            twin.region,
            model=twin.lane_model,
            mesh=twin.mesh,
            sensors=twin.rig_spec().standing(),
            corrections=twin.corrections,
            title=name,
            attribution=sources,
        )
    if picture == "scene":
        return _figure_of_scene(twin)
    if picture == "ground":
        return ground_figure(
            twin.mesh,
            twin.surface_materials,
            twin.region,
            title=f"{name}   materials of the ground",
            attribution=sources,
        )
    if picture == "sight":
        sight = sight_on(twin)
        if sight is None:
            raise InputError("no junction is in sight of the rig", expected="a rig at a junction")
        return _figure_of_sight(twin, sight)
    raise InputError(
        f"there is no picture {picture!r:.40}", expected="plan, sight, scene or ground"
    )


def sight_on(twin: Twin) -> RigSight | None:
    """Return the part of the junction visible to a twin's own rig; see `sight_of_rig`."""
    rig = place_rig(
        twin.rig_spec(), twin.mesh, file=twin.rig_path, anchor_height_m=twin.anchor_height_m
    )
    return sight_of_rig(rig, twin.roads, twin.region, twin.mesh)


def _figure_of_sight(twin: Twin, sight: RigSight) -> Figure:
    return sight_figure(
        sight,
        twin.roads,
        model=twin.lane_model,
        mesh=twin.mesh,
        sensors=twin.rig_spec().standing(),
        title=title_of(twin),
        attribution=attributions(twin.manifest),
    )


def picture_of_motion(motion: Motion, twin: Twin, path: Path) -> Path:
    """Draw the paths of a motion's actors on its twin into a PNG."""
    return style.save(figure_of_motion(motion, twin), path)


def figure_of_motion(motion: Motion, twin: Twin | None) -> Figure:
    """Draw the paths of a motion's actors, on its twin if given."""
    sources = [] if twin is None else attributions(twin.manifest)
    return paths_figure(motion, twin, attribution=sources)


def redraw_split(dataset: Path) -> None:
    """Redraw the picture of a dataset's split, for example after a change of the split files.

    Raises:
        InputError: a file of the dataset is missing or damaged.
    """
    file = dataset / "pictures" / PICTURE_OF_SPLIT
    file.unlink(missing_ok=True)
    sources = attributions(read_manifest(dataset))
    picture_of_split(read_statistics(dataset), image_sets(dataset), file, sources)


def pictures_of_dataset(
    dataset: Path,
    out: Path | None = None,
    *,
    twin: Twin | None = None,
    motion: Motion | None = None,
    pool: ProcessPoolExecutor | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Draw a recorded dataset: the frame with the most labelled actors, and its classes.

    The pictures are ``birdseye.png``, ``range_image.png``, ``histogram.png`` and those of
    `pictures_of_boxes` for all frames. If the twin and its motion are given, ``scene.png`` shows
    the same moment in the twin with its actors. In a folder with a dataset for each sensor, the
    pictures of all are drawn.

    Args:
        dataset: the dataset's folder.
        out: output folder; default: the dataset's ``pictures/``.
        twin: the twin in which it was recorded.
        motion: the motion from which it was recorded.
        pool: helper processes, which draw the frame and the boxes while this process draws the
            scene.
        progress: called with the share done and the current task.

    Raises:
        InputError: there is no dataset, or a file of it is missing.
    """
    tell = progress or untold
    parts = parts_of(dataset)
    if parts != [dataset]:
        drawn = []
        for part in parts:
            own = None if out is None else out / part.name
            drawn += pictures_of_dataset(
                part, own, twin=twin, motion=motion, pool=pool, progress=progress
            )
        return drawn
    manifest = read_manifest(dataset)
    sources = attributions(manifest)
    frame = read_labelled_points(dataset)
    out = dataset / "pictures" if out is None else out
    out.mkdir(parents=True, exist_ok=True)

    drawn = []
    with (
        begun(pool, _pictures_of_frame, frame, manifest, out, sources) as of_frame,
        begun(pool, _pictures_of_boxes, dataset, out, sources) as of_boxes,
    ):
        if twin is not None and motion is not None:
            tell(0.0, "drawing the scene")
            actors = actor_meshes(rows_at(motion, frame.time_s), motion.mesh)
            figure = scene_figure(
                LabelledMesh.concatenate([twin.mesh, *actors]),
                title=title_of(twin),
                below=f"frame {frame.name}   {frame.time_s:.1f} s",
                attribution=sources,
                surface=twin.surface_materials,
                colours=twin.colours,
                tell=between(tell, 0.0, 0.5),
            )
            drawn.append(style.save(figure, out / "scene.png"))
        tell(0.5, "drawing a frame")
        drawn += of_frame()
        tell(0.8, "drawing all boxes")
        drawn += of_boxes()
    tell(1.0, "drawn")
    return drawn


def _pictures_of_boxes(dataset: Path, out: Path, sources: list[str]) -> list[Path]:
    return pictures_of_boxes(read_statistics(dataset), image_sets(dataset), out, sources)


def _pictures_of_frame(
    frame: LabelledPoints, manifest: dict[str, Any], out: Path, sources: list[str]
) -> list[Path]:
    """Draw a frame, and the number of points and boxes of each class."""
    kinds = ["birdseye", "range_image"] if len(frame.points) else ["birdseye"]
    figures = {kind: _figure_of_frame(frame, kind, sources) for kind in kinds}
    figures["histogram"] = _figure_of_counts(manifest)
    return [style.save(figure, out / f"{kind}.png") for kind, figure in figures.items()]


def picture_of_fleet(fleet: Fleet, path: Path) -> Path:
    """Draw the points of the nodes of a fleet at one moment into a PNG."""
    return style.save(figure_of_fleet(fleet, attribution=attributions(fleet.manifest)), path)


def figure_of_dataset(dataset: Path, frame: str | None, picture: str) -> Figure:
    """Draw a frame of a dataset, or its number of points and boxes of each class.

    Args:
        dataset: its folder.
        frame: the frame's name; default: the frame with the most labelled actors.
        picture: ``birdseye``, ``range_image`` or ``histogram``.

    Raises:
        InputError: there is no such frame or picture, or a file of it is missing.
    """
    manifest = read_manifest(dataset)
    if picture == "histogram":
        return _figure_of_counts(manifest)
    return _figure_of_frame(read_labelled_points(dataset, frame), picture, attributions(manifest))


def _figure_of_frame(frame: LabelledPoints, picture: str, sources: list[str]) -> Figure:
    if picture == "birdseye":
        return birdseye_figure(frame, attribution=sources)
    if picture == "range_image":
        sensor = 0
        if frame.sensor is not None and len(frame.sensor):
            sensor = int(frame.sensor[len(frame.sensor) // 2])
        return range_image_figure(frame, sensor=sensor, attribution=sources)
    raise InputError(
        f"there is no picture {picture!r:.40}", expected="birdseye, range_image or histogram"
    )


def _figure_of_counts(manifest: dict[str, Any]) -> Figure:
    counts = manifest["counts"]
    points, frames = counts["points_by_class"], counts["frames"]
    return histogram_figure(
        points,
        counts["boxes"],
        counts["boxes_with_points"],
        below=f"{frames:,} frame{'' if frames == 1 else 's'}   {sum(points.values()):,} points",
        attribution=attributions(manifest),
    )


def picture_of_coverage(coverage: Coverage, rig: Rig, twin: Twin, path: Path) -> Path:
    """Draw the coverage of a rig on a twin into a PNG; see `figure_of_coverage`."""
    return style.save(figure_of_coverage(coverage, rig, twin), path)


def figure_of_coverage(coverage: Coverage, rig: Rig, twin: Twin) -> Figure:
    """Draw the coverage of a rig on a twin.

    Args:
        coverage: coverage of the rig.
        rig: its sensors.
        twin: twin of the site.
    """
    places = [one.site_SE3_sensor.translation for one in rig.sensors]
    return coverage_figure(
        coverage,
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


def actor_meshes(
    rows: Rows, mesh_of: Callable[[str, int], LabelledMesh] = asset_mesh
) -> list[LabelledMesh]:
    """Return the posed meshes of the actors at one moment, with their track as ``part``.

    Args:
        rows: the actors.
        mesh_of: function for the mesh of an asset and phase; default: that of the catalogue.
    """
    meshes = []
    for row in rows:
        pose = Pose.from_ypr([row["x"], row["y"], row["z"]], row["yaw"], row["pitch"], row["roll"])
        mesh = mesh_of(str(row["asset"]), int(row["phase"])).transformed(pose)
        meshes.append(
            LabelledMesh.build(
                mesh.vertices, mesh.faces, mesh.semantic, mesh.material, int(row["track"])
            )
        )
    return meshes


def title_of(twin: Twin) -> str:
    """Return the twin's name, or its coordinates if the name cannot be drawn."""
    where = f"{abs(twin.frame.latitude):.4f}° {'N' if twin.frame.latitude >= 0 else 'S'}, "
    where += f"{abs(twin.frame.longitude):.4f}° {'E' if twin.frame.longitude >= 0 else 'W'}"
    return legible(str(twin.manifest.get("name") or "")) or f"Intersection at {where}"


def attributions(manifest: dict[str, Any]) -> list[str]:
    """Return the attributions of the inputs of an artefact, each once."""
    found = [str(one.get("attribution") or "") for one in manifest.get("inputs", [])]
    return [one for one in dict.fromkeys(found) if one not in ("", "not stated")]


def _size(twin: Twin) -> str:
    x0, y0, x1, y1 = twin.region.bounds
    triangles = len(twin.mesh.faces)
    return f"{x1 - x0:.0f} x {y1 - y0:.0f} m   {triangles:,} triangles"


def pictures_of_events(motion: Motion, twin: Twin, folder: Path) -> list[Path]:
    """Draw each event of a motion into a folder, ``event-01-near_miss.png`` and so on."""
    drawn = []
    for number, event in enumerate(motion.manifest.get("events", ()), 1):
        figure = event_figure(motion, twin, event, attribution=attributions(twin.manifest))
        path = folder / f"event-{number:02d}-{event['event']}.png"
        drawn.append(style.save(figure, path))
    return drawn
