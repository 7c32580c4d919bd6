"""Alignment of a rig: averages several frames, writes the rig's file and a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.align import Alignment, Guess, align
from urbantwin.fidelity.alignment.ground_plane import thinned
from urbantwin.fidelity.alignment.lane_markings import mark_lines
from urbantwin.fidelity.alignment.road_edges import road_edges
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.report_style import INK, blank, from_above, save
from urbantwin.geometry import Pose, ypr_from_rotation
from urbantwin.lidar import Rig
from urbantwin.lidar.rig import dataset_frame
from urbantwin.twin import Twin

__all__ = [
    "Wish",
    "align_rig",
    "aligned_poses",
    "averaged",
    "draw_alignment",
    "frame_numbers",
    "write_aligned_rig",
]

#: Maximum spread of the frames' positions (metres; at least six standard deviations are allowed)
#: and rotations (degrees): larger ones reveal a moving sensor.
_APART_M, _APART_DEG = 0.5, 3.0


def averaged(found: Sequence[Alignment], file: str | None = None) -> Alignment:
    """Return the mean pose, with residuals and shares of the frame nearest to it.

    Frames of one place share the errors of the twin. The standard deviations are therefore the
    frames' own (root mean square), not reduced by their number, plus their scatter.

    Args:
        found: alignment of each frame, at least one.
        file: source of the frames, for errors.

    Raises:
        InputError: the frames are from different places.
    """
    if len(found) == 1:
        return found[0]
    turns = Rotation.from_matrix(np.stack([one.pose.rotation for one in found]))
    places = np.stack([one.pose.translation for one in found])
    turn, place = turns.mean(), places.mean(axis=0)
    off = np.linalg.norm(places - place, axis=1)
    turned = (turns * turn.inv()).as_rotvec()
    claimed = np.stack([one.found.sigma_m for one in found])
    apart = float(np.ptp(places, axis=0).max())
    most = max(_APART_M, 6.0 * float(np.linalg.norm(claimed, axis=1).max()))
    if apart > most or np.degrees(np.abs(turned)).max() > _APART_DEG:
        raise InputError(
            f"its frames are from places {apart:.2f} m and "
            f"{2 * np.degrees(np.abs(turned)).max():.1f} degrees apart",
            file=file,
            expected="frames of a static sensor, or one frame",
        )
    nearest = found[int(off.argmin())]
    count = len(found)
    claimed_deg = np.stack([one.found.sigma_deg for one in found])
    sigma_m = np.sqrt((claimed**2).mean(axis=0) + places.var(axis=0, ddof=1) / count)
    spread = np.degrees(turned).var(axis=0, ddof=1) / count
    pose = Pose(turn.as_matrix(), place)
    return replace(
        nearest,
        pose=pose,
        found=replace(
            nearest.found,
            pose=pose,
            sigma_m=sigma_m,
            sigma_deg=np.sqrt((claimed_deg**2).mean(axis=0) + spread),
        ),
        frames=count,
        scatter_m=float(np.sqrt((off**2).mean())),
    )


_PLACE = (
    *("east_m", "north_m", "latitude", "longitude", "height_m", "up_m", "altitude_m"),
    *("yaw_deg", "heading_deg", "pitch_deg", "tilt_deg", "roll_deg"),
)


def aligned_poses(
    rig: Rig,
    site_SE3_frame: Pose,
    points_in: Literal["sensor", "level"] = "sensor",
    only: int | None = None,
) -> list[Pose]:
    """Return the poses of a rig's sensors after the alignment of one of them.

    Args:
        rig: the rig before alignment.
        site_SE3_frame: the pose of the real frame.
        points_in: frame of the real points: that of the first sensor, or ``level``: its position
            and heading with z against gravity, which keeps the rig's tilt.
        only: index of the aligned sensor, which alone moves. If not given, the first was aligned
            and the others move with it.
    """
    before = rig.sensors[only or 0].site_SE3_sensor
    move = site_SE3_frame @ dataset_frame(points_in, before).inverse()
    return [
        move @ one.site_SE3_sensor if only in (None, number) else one.site_SE3_sensor
        for number, one in enumerate(rig.sensors)
    ]


def write_aligned_rig(source: Path, target: Path, poses: list[Pose]) -> None:
    """Write a rig's file with new poses of its sensors, atomically.

    All else in the file is kept, except for comments.

    Args:
        source: the rig's file, valid.
        target: the file to write; it may be the same.
        poses: ``site_SE3_sensor`` of each sensor.

    Raises:
        InputError: the rig is mounted on an actor, or ``target`` is a folder.
    """
    document: dict[str, Any] = yaml.safe_load(source.read_text(encoding="utf-8"))
    if document.get("ride") is not None:
        raise InputError(
            "its rig is mounted on a vehicle", file=source, place="ride", expected="a static rig"
        )
    for entry, pose in zip(document["sensors"], poses, strict=True):
        for name in _PLACE:
            entry.pop(name, None)
        entry.update(_written(pose))
    with replaced_file(target, kind="align", replaces=source) as scratch:
        scratch.write_text(
            yaml.safe_dump(document, sort_keys=False, allow_unicode=True), encoding="utf-8"
        )


def _written(pose: Pose) -> dict[str, float]:
    angles = np.degrees(ypr_from_rotation(pose.rotation))
    values = dict(zip(("east_m", "north_m", "up_m"), pose.translation, strict=True))
    values |= dict(zip(("yaw_deg", "pitch_deg", "roll_deg"), angles, strict=True))
    return {name: round(float(value), 4) + 0.0 for name, value in values.items()}


_REACH_M, _FARTHEST_M, _THINNED_M = 35.0, 0.5, 0.15
_EDGE, _LINE = "#1d2733", "#e8710a"


def draw_alignment(frame: Frame, twin: Twin, found: Alignment, path: Path) -> None:
    """Draw the points from above, coloured by their distance to the twin's surface.

    Args:
        frame: the real frame.
        twin: the twin.
        found: the pose, and the start of the search.
        path: the PNG to write.
    """
    middle = found.pose.translation
    around = np.abs(twin.mesh.vertices[twin.mesh.faces][..., :2] - middle[:2])
    near = twin.mesh.select((around.min(axis=1) < 2 * _REACH_M).all(axis=1))
    surface = NearestTriangle(near.vertices, near.faces.astype(np.int64))
    edges = road_edges(twin.ground_mesh)[0]
    lines = mark_lines(twin.surface_materials, middle[:2], _REACH_M)[0]
    away = frame.points - frame.sensor_places.mean(axis=0)
    points = frame.points[np.hypot(*away[:, :2].T) < 1.5 * _REACH_M]
    points = points[thinned(points, _THINNED_M)]
    moving = [("Where the search began", found.start), ("Aligned", found.pose)]
    shown = [(title, pose) for title, pose in moving if pose is not None]
    figure = blank(7.4 * len(shown) + 1.2, 7.6)
    grid = figure.add_gridspec(
        1, len(shown), left=0.05, right=1 - 1.1 / (7.4 * len(shown) + 1.2), top=0.94, bottom=0.06
    )
    for place, (title, pose) in enumerate(shown):
        axes = figure.add_subplot(grid[0, place])
        at = pose.apply(points)
        distance = surface.distances(at)
        said = f"{title}: {_share(distance):.0%} of the points within 0.1 m of the twin"
        shades = colormaps["turbo"](np.clip(distance / _FARTHEST_M, 0, 1))[:, :3]
        from_above(axes, said, middle, _REACH_M, [(at, shades)])
        for marks, colour in ((edges, _EDGE), (lines, _LINE)):
            axes.plot(*marks[:, :2].T, ".", color=colour, markersize=1.5)
    colours = ScalarMappable(Normalize(0, _FARTHEST_M), "turbo")
    bar = figure.colorbar(colours, ax=figure.axes, fraction=0.025, pad=0.02)
    bar.set_label("metres from the twin's surface (black: edges of its roads, orange: its lines)")
    bar.ax.yaxis.label.set_color(INK)
    with replaced_file(path, kind="align picture") as scratch:
        save(figure, scratch)


def _share(distance: NDArray[np.float64]) -> float:
    return float((distance < 0.1).mean())


#: Minimum share of the frames that must be aligned.
_ENOUGH = 0.5


@dataclass(frozen=True)
class Wish:
    """Options of an alignment: the approximate pose, and the frames to use.

    Attributes:
        guess: east and north in metres, and the heading of the points' x axis in degrees
            counter-clockwise from east; the rig's pose if not given.
        anywhere: search the whole region without a guess.
        within: maximum error of the guess, metres and degrees.
        level: the points have the sensor's position and heading, but are level with gravity.
        frames: numbers of the frames, from 0, of which the mean pose is used; all if None.
        sensor: name of the sensor that recorded, which alone moves. If not given, it is the first,
            and the others move with it.
    """

    guess: tuple[float, float, float] | None = None
    anywhere: bool = False
    within: tuple[float, float] = (3.0, 15.0)
    level: bool = False
    frames: tuple[int, ...] | None = (0,)
    sensor: str | None = None


def frame_numbers(text: str) -> tuple[int, ...] | None:
    """Return the numbers in ``0,5,10``; None for ``all``.

    Raises:
        InputError: the text is neither.
    """
    if text.strip().lower() == "all":
        return None
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 10 for part in parts):
        raise InputError(f"frames are {text!r}", expected="numbers like 0,5,10, or all")
    return tuple(dict.fromkeys(int(part) for part in parts))


def align_rig(
    real: Path,
    twin: Twin,
    rig: Rig,
    source: Path,
    target: Path,
    wish: Wish | None = None,
    progress: Callable[[float, str], None] | None = None,
    picture: Path | None = None,
) -> Alignment:
    """Find the pose of a rig's sensor from real frames, and write the rig.

    Args:
        real: a recording of that sensor.
        twin: twin of the recorded place.
        rig: the rig before alignment.
        source: the rig's file.
        target: the file to write; not written if the alignment fails.
        wish: options.
        progress: called with the fraction done (0..1) and the current step.
        picture: a PNG of the points over the twin to write.

    Raises:
        InputError: see `align.align`, if more than half of the frames fail; frames from different
            places; a missing frame or sensor; contradictory options; a rig mounted on an actor; a
            target inside a twin, whose files are sealed.
    """
    wish = wish or Wish()
    guess, within = wish.guess, wish.within
    if guess is not None and wish.anywhere:
        raise InputError("a guess and anywhere are both given", expected="one of them")
    if not (0 < within[0] <= 200 and 0 < within[1] <= 180):
        raise InputError(
            f"the span of the search is {within[0]:g} m and {within[1]:g} degrees",
            expected="up to 200 m and 180 degrees, above 0",
        )
    if rig.ride is not None:
        raise InputError(
            "its rig is mounted on a vehicle", file=source, place="ride", expected="a static rig"
        )
    if (target.parent / "twin.json").exists():
        raise InputError("would change a twin", file=target, expected="a file elsewhere")
    number = _number(rig, wish.sensor, source)
    recording = open_recording(real)
    frames = wish.frames if wish.frames is not None else tuple(range(len(recording)))
    missing = [frame for frame in frames if not 0 <= frame < len(recording)]
    if missing or not frames:
        raise InputError(
            f"has no frame {missing[0]}" if missing else "has no frames",
            file=real,
            expected=f"0 to {len(recording) - 1}",
        )
    points_in: Literal["sensor", "level"] = "level" if wish.level else "sensor"
    rough = None
    if not wish.anywhere:
        if guess is None:
            pose = dataset_frame(points_in, rig.sensors[number].site_SE3_sensor)
            yaw = float(np.degrees(ypr_from_rotation(pose.rotation)[0]))
            guess = (float(pose.translation[0]), float(pose.translation[1]), yaw)
        rough = Guess(*guess, *within)
    found: list[Alignment] = []
    first: Frame | None = None
    failed: InputError | None = None
    for done, frame in enumerate(frames):

        def tell(share: float, text: str, done: int = done) -> None:
            if progress is not None:
                progress((done + share) / len(frames), text)

        try:
            read = recording.read(frame)
            one = align(
                read,
                twin.mesh,
                guess=rough,
                region=twin.region,
                surface=twin.surface_materials,
                file=f"{real}: {recording.names[frame]}",
                progress=tell,
            )
        except InputError as error:
            failed = failed or error
            continue
        found.append(one)
        first = first or read
    if failed is not None and (first is None or len(found) < _ENOUGH * len(frames)):
        raise failed
    assert first is not None
    mean = averaged(found, str(real))
    poses = aligned_poses(rig, mean.pose, points_in, None if wish.sensor is None else number)
    write_aligned_rig(source, target, poses)
    if picture is not None:
        draw_alignment(first, twin, mean, picture)
    return replace(mean, left_out=len(frames) - len(found))


def _number(rig: Rig, name: str | None, source: Path) -> int:
    names = [one.name for one in rig.sensors]
    if name is None:
        return 0
    if name not in names:
        raise InputError(f"has no sensor {name!r}", file=source, expected=" or ".join(names))
    return names.index(name)
