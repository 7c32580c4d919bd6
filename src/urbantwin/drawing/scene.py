"""A perspective picture of the twin: ray-cast mesh with sun, shadow and ambient light.

It needs no window and no graphics card. `RayScene` casts one ray per sub-pixel, and from its hit
one ray towards the sun and one in a random direction around the surface's normal. The share of the
random rays without a close hit, averaged over neighbouring pixels, is the ambient light. Seeds are
fixed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from urbantwin.drawing import style
from urbantwin.drawing.picture_light import HORIZON, SAMPLES, scattered_about, sky, smoothed, toned
from urbantwin.drawing.surface_colours import material_colours, surface_colours
from urbantwin.geometry import DownwardProbe, LabelledMesh, PartColours, SurfaceMaterials
from urbantwin.geometry.rays import RayScene
from urbantwin.geometry.surface_material import taking
from urbantwin.progress import Progress, between, untold
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = [
    "Camera",
    "clear_camera",
    "render",
    "scene_figure",
    "scene_picture",
]

_SUNLIGHT = np.array([1.0, 0.94, 0.83], np.float32)
_SKYLIGHT = np.array([0.40, 0.46, 0.55], np.float32)
_GROUNDLIGHT = np.array([1.0, 0.93, 0.82], np.float32)
#: A random ray without a hit within this distance reaches the sky, metres.
_AMBIENT_M = 12.0
#: The streets within this distance of the target are the junction, metres.
JUNCTION_M = 35.0
#: Elevations of the candidate cameras, and their offsets from the default azimuth.
ELEVATIONS_DEG = (29.0, 36.0, 44.0, 53.0, 62.0, 72.0)
TURNS_DEG = (0, 25, -25, 50, -50, 75, -75, 100, -100, 130, -130, 155, -155, 180)
#: Penalty for one degree of steepness, in shares of the visible junction.
STEEPNESS = 0.004
#: Objects lower than this above the junction do not count as obstacles, metres.
HIGH_M = 5.0
#: Rows of sub-pixels cast at once.
_BAND = 32 * SAMPLES
_OFFSET_M = 2e-3


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera directed at a point from above.

    Attributes:
        target: (3,) point in the middle of the picture, site frame, metres.
        distance_m: distance from the target.
        azimuth_deg: direction from the target to the camera: counter-clockwise from east.
        elevation_deg: elevation of the camera, seen from the target.
        field_deg: horizontal field of view.
    """

    target: ArrayLike = (0.0, 0.0, 0.0)
    distance_m: float = 165.0
    azimuth_deg: float = -65.0
    elevation_deg: float = 29.0
    field_deg: float = 48.0

    @property
    def place(self) -> NDArray[np.float64]:
        """Position of the camera (3,)."""
        a, e = np.radians([self.azimuth_deg, self.elevation_deg])
        back = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return np.asarray(self.target, np.float64) + self.distance_m * back

    @property
    def sun(self) -> NDArray[np.float32]:
        """Direction of the sun (3,): over the right shoulder, so that shadows are visible."""
        a, e = np.radians([self.azimuth_deg + 48.0, 42.0])
        way = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        return np.array(way, np.float32)

    def rays(self, width: int, height: int) -> NDArray[np.float32]:
        """Return unit directions (height, width, 3) through the middles of the pixels."""
        forward = np.asarray(self.target, np.float64) - self.place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        half = np.tan(np.radians(self.field_deg) / 2)
        x = half * ((np.arange(width) + 0.5) / width * 2 - 1)
        y = half * (1 - (np.arange(height) + 0.5) / height * 2) * height / width
        across = (x[:, None] * right).astype(np.float32)
        upward = (forward + y[:, None] * up).astype(np.float32)
        out = upward[:, None, :] + across[None, :, :]
        out /= np.sqrt(np.einsum("ijk,ijk->ij", out, out))[..., None]
        return np.asarray(out, np.float32)


def scene_picture(  # noqa: PLR0913 - what is drawn, from where, and what is written on it
    mesh: LabelledMesh,
    path: Path,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = (1440, 810),
    title: str = "",
    below: str = "",
    attribution: str | Iterable[str] = (),
    surface: SurfaceMaterials | None = None,
    colours: PartColours | None = None,
) -> Path:
    """Draw the twin's mesh from above, in daylight.

    Args:
        mesh: the mesh to draw, site frame, metres: the static scene, with or without actors.
        path: the PNG to write.
        camera: the camera; default: the one with the most of the middle visible.
        size: width and height of the picture, pixels.
        title: text in the sky.
        below: a line under it.
        attribution: sources of the data.
        surface: materials of the ground that are finer than the mesh.
        colours: colours of its buildings.
    """
    figure = scene_figure(
        mesh,
        camera=camera,
        size=size,
        title=title,
        below=below,
        attribution=attribution,
        surface=surface,
        colours=colours,
    )
    return style.save(figure, path)


def scene_figure(  # noqa: PLR0913 - as `scene_picture`
    mesh: LabelledMesh,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = (1440, 810),
    title: str = "",
    below: str = "",
    attribution: str | Iterable[str] = (),
    surface: SurfaceMaterials | None = None,
    colours: PartColours | None = None,
    tell: Progress = untold,
) -> Figure:
    """Return the figure of ``scene_picture``; ``tell`` is called with the share done (0..1)."""
    caster = _Caster(mesh)
    camera = camera or _clearest(caster, Camera(), ELEVATIONS_DEG)
    width, height = size
    picture = _rendered(caster, camera, width, height, surface, colours, between(tell, 0.2, 0.9))
    figure = style.new_figure(width / 100, height / 100)
    axes = figure.add_axes((0, 0, 1, 1))
    style.bare(axes)
    axes.imshow(picture, interpolation="nearest", aspect="auto")
    if title:
        shade = np.zeros((64, 1, 4))
        shade[..., :3] = np.array([0.06, 0.09, 0.12])
        shade[:, 0, 3] = np.linspace(0.75, 0.0, 64) ** 1.3
        axes.imshow(shade, extent=(-0.5, width - 0.5, 0.17 * height, -0.5), aspect="auto", zorder=2)
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
        style.title(figure, title, below, x=0.025, top=0.965, colour=style.INK)
    sources = style.joined(attribution)
    if sources:
        figure.text(
            0.988,
            0.014,
            sources,
            color=style.INK,
            fontsize=9,
            ha="right",
            va="bottom",
            bbox={"facecolor": style.PAPER, "alpha": 0.6, "lw": 0, "pad": 3},
        )
    return figure


def clear_camera(
    mesh: LabelledMesh,
    target: ArrayLike = (0.0, 0.0, 0.0),
    *,
    usual: Camera | None = None,
    elevations_deg: Sequence[float] = ELEVATIONS_DEG,
) -> Camera:
    """Return the camera with the most of the junction visible.

    Candidate cameras all around and at several elevations are evaluated with rays. The score is the
    visible share of the streets within ``JUNCTION_M`` (of any ground, if there are none). The share
    of the picture that walls and roofs in front of the junction take is subtracted, and a small
    penalty for every degree above the lowest elevation.

    Args:
        mesh: the static scene, site frame, metres.
        target: (3,) the target point, metres.
        usual: camera with the distance, field and azimuth of the candidates.
        elevations_deg: elevations of the candidates, seen from the target; the lowest first.
    """
    like = replace(usual or Camera(), target=target)
    return _clearest(_Caster(mesh), like, elevations_deg)


def _clearest(caster: _Caster, like: Camera, elevations_deg: Sequence[float]) -> Camera:
    """Return the camera of `clear_camera` for a given target, distance and field of view."""
    middle = np.asarray(like.target, np.float64)
    places = _streets_about(caster, middle)
    best, most = like, -np.inf
    for elevation in elevations_deg:
        for turn in TURNS_DEG:
            azimuth = like.azimuth_deg + turn
            camera = replace(like, azimuth_deg=azimuth, elevation_deg=elevation)
            worth = _seen(caster, camera, places) - _in_the_way(caster, camera, middle)
            worth -= STEEPNESS * (elevation - elevations_deg[0])
            if worth > most + 1e-3:
                best, most = camera, worth
    return best


def _streets_about(caster: _Caster, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (N, 3) half a metre above the streets, or the ground, about a place."""
    spread = np.arange(-JUNCTION_M, JUNCTION_M + 1, 3.5)
    x, y = (grid.ravel() for grid in np.meshgrid(spread, spread))
    xy = np.column_stack([x, y])[np.hypot(x, y) <= JUNCTION_M] + middle[:2]
    above = np.column_stack([xy, np.full(len(xy), middle[2] + 3.0)])
    mesh = caster.mesh
    up = caster.normals[:, 2] > 0.5
    for classes in (("road", "sidewalk"), GROUND_CLASSES):
        streets = up & np.isin(mesh.semantic, [semantic_id(name) for name in classes])
        height = DownwardProbe(mesh.select(streets)).height_below(above)
        known = np.isfinite(height)
        if known.mean() > 0.05:
            return np.column_stack([xy[known], height[known] + 0.5])
    return np.column_stack([xy, np.full(len(xy), middle[2] + 0.5)])


def _seen(caster: _Caster, camera: Camera, places: NDArray[np.float64]) -> float:
    """Return the share of places (N, 3) from which the camera is visible."""
    way = camera.place - places
    reach = np.linalg.norm(way, axis=1)
    way /= reach[:, None]
    _, distance = caster.first(places.astype(np.float32), way.astype(np.float32))
    return float((distance > reach).mean())


def _in_the_way(caster: _Caster, camera: Camera, middle: NDArray[np.float64]) -> float:
    """Return the share of the picture taken by tall objects in front of the junction."""
    rays = camera.rays(32, 18).reshape(-1, 3)
    origin = camera.place.astype(np.float32)
    _, distance = caster.first(np.tile(origin, (len(rays), 1)), rays)
    top = camera.place[2] + distance * rays[:, 2]
    near = distance < camera.distance_m - JUNCTION_M / 2
    return float((near & (top > middle[2] + HIGH_M)).mean())


def render(
    mesh: LabelledMesh,
    camera: Camera,
    width: int,
    height: int,
    surface: SurfaceMaterials | None = None,
    colours: PartColours | None = None,
) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), 0..255.

    Args:
        mesh: the mesh to draw, site frame, metres.
        camera: the camera.
        width: pixels.
        height: pixels.
        surface: materials of the ground that are finer than the mesh.
        colours: colours of its buildings.
    """
    return _rendered(_Caster(mesh), camera, width, height, surface, colours, untold)


def _rendered(
    caster: _Caster,
    camera: Camera,
    width: int,
    height: int,
    surface: SurfaceMaterials | None,
    colours: PartColours | None,
    tell: Progress,
) -> NDArray[np.uint8]:
    """Return the picture of `render`."""
    rays = camera.rays(width * SAMPLES, height * SAMPLES)
    sun = camera.sun
    origin = camera.place.astype(np.float32)
    bands = [slice(at, at + _BAND) for at in range(0, len(rays), _BAND)]
    seen = _Seen.empty(rays.shape[:2])
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        looked = pool.map(lambda band: _look(caster, origin, rays, sun, seen, band), bands)
        for done, _ in enumerate(looked, 1):
            tell(0.7 * done / len(bands), "drawing the scene")
        ambient = smoothed(seen.sky)
        seen_colours = _Colours(caster.mesh, surface, colours, camera.place)
        picture = np.empty((height, width, 3), np.float32)

        def paint(band: slice) -> None:
            shaded = _shade(seen_colours, rays, sun, seen, ambient, band, camera.distance_m)
            rows = slice(band.start // SAMPLES, band.start // SAMPLES + len(shaded) // SAMPLES)
            every = [(i, j) for i in range(SAMPLES) for j in range(SAMPLES)]
            picture[rows] = sum(shaded[i::SAMPLES, j::SAMPLES] for i, j in every)
            picture[rows] /= np.float32(len(every))

        for done, _ in enumerate(pool.map(paint, bands), 1):
            tell(0.7 + 0.3 * done / len(bands), "drawing the scene")
    return (np.clip(toned(picture), 0, 1) * 255 + 0.5).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Hits of each sub-pixel's rays: (H, W) arrays, nan or -1 without a hit."""

    face: NDArray[np.int32]
    distance: NDArray[np.float32]
    sun: NDArray[np.float32]
    sky: NDArray[np.float32]
    up: NDArray[np.float32]  # z of the normal towards the camera

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> _Seen:
        floats = [np.full(shape, np.nan, np.float32) for _ in range(4)]
        return cls(np.full(shape, -1, np.int32), *floats)


class _Colours:
    """Colours of the hits of rays from one origin."""

    def __init__(
        self,
        mesh: LabelledMesh,
        surface: SurfaceMaterials | None,
        colours: PartColours | None,
        origin: NDArray[np.float64],
    ) -> None:
        self._surface = surface if surface is not None and surface.layers else None
        self._origin = origin
        if self._surface is not None:
            self._own = mesh.material  # material of each triangle
            self._takes = taking(mesh, np.arange(len(mesh.faces)))
        self._faces = surface_colours(mesh, colours).astype(np.float32)
        self._materials = material_colours().astype(np.float32)

    def of(
        self,
        face: NDArray[np.int32],
        way: NDArray[np.float32],
        distance: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Return the colour (N, 3) of hits of rays with directions ``way`` (N, 3) on faces (N,)."""
        found = self._faces.take(face, axis=0)
        if self._surface is not None:
            which = np.flatnonzero(self._takes[face])
            places = (
                self._origin + way.take(which, axis=0).astype(np.float64) * distance[which, None]
            )
            material = self._surface.at(places)
            own = self._own[face[which]]
            finer = (material > 0) & (material != own)
            found[which[finer]] = self._materials[material[finer]]
        return found


def _look(
    caster: _Caster,
    origin: NDArray[np.float32],
    rays: NDArray[np.float32],
    sun: NDArray[np.float32],
    seen: _Seen,
    band: slice,
) -> None:
    """Cast the rays of a band of rows: to the mesh, from there to the sun and at random."""
    directions = rays[band].reshape(-1, 3)
    face, distance = caster.first(origin, directions, beside=True)
    hit = np.flatnonzero(face >= 0)
    # Rows by ``take``: an index takes many times as long.
    way = directions.take(hit, axis=0)
    normal = caster.normals.take(face[hit], axis=0)
    normal *= -np.sign(np.einsum("ij,ij->i", normal, way))[:, None]
    place = origin + way * distance[hit, None] + normal * _OFFSET_M
    facing = np.maximum(normal @ sun, np.float32(0))
    lit = np.flatnonzero(facing > 0)
    _, to_sun = caster.first(place.take(lit, axis=0), sun, beside=True)
    facing[lit[np.isfinite(to_sun)]] = 0
    # One sub-pixel per pixel casts a random ray: the average over neighbours is used.
    shape = seen.face[band].shape
    column, row = hit % shape[1], hit // shape[1]
    few = np.flatnonzero((column % SAMPLES == 0) & (row % SAMPLES == 0))
    _, around = caster.first(
        place.take(few, axis=0), scattered_about(normal.take(few, axis=0), seed=band.start)
    )

    seen.face[band] = face.reshape(shape)
    seen.distance[band] = distance.reshape(shape)
    seen.sun[band].ravel()[hit] = facing
    seen.sky[band].ravel()[hit[few]] = around >= _AMBIENT_M
    seen.up[band].ravel()[hit] = normal[:, 2]


def _shade(
    colours: _Colours,
    rays: NDArray[np.float32],
    sun: NDArray[np.float32],
    seen: _Seen,
    ambient: NDArray[np.float32],
    band: slice,
    distance_m: float,
) -> NDArray[np.float32]:
    """Return the light (rows, W, 3) of a band of rows."""
    face, distance = seen.face[band].ravel(), seen.distance[band].ravel()
    colour = np.empty((len(face), 3), np.float32)
    missed, hit = np.flatnonzero(face < 0), np.flatnonzero(face >= 0)
    colour[missed] = sky(rays[band].reshape(-1, 3)[missed, 2])
    up = seen.up[band].ravel()[hit]
    open_sky = ambient[band].ravel()[hit]
    light = seen.sun[band].ravel()[hit, None] * _SUNLIGHT
    light += (open_sky * (0.65 + 0.35 * up))[:, None] * _SKYLIGHT
    light += (open_sky * 0.12 * (1 - up))[:, None] * _GROUNDLIGHT
    haze = (1 - np.exp(-np.maximum(distance[hit] - distance_m, 0) / np.float32(700)))[:, None]
    own = colours.of(face[hit], rays[band].reshape(-1, 3).take(hit, axis=0), distance[hit])
    colour[hit] = own * light * (1 - haze) + HORIZON * haze
    return colour.reshape(*seen.face[band].shape, 3)


class _Caster:
    """Casts rays; bands of a picture may be cast in threads."""

    def __init__(self, mesh: LabelledMesh) -> None:
        self.mesh = mesh
        self._scene = RayScene(mesh.vertices, mesh.faces)
        self.normals = mesh.normals().astype(np.float32)

    def first(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], *, beside: bool = False
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the first face (N,) along each ray, -1 for none, and its distance (N,).

        Origins or directions may be a single (3,) for all rays; ``beside`` as in
        `RayScene.cast_single`.
        """
        origins, directions = np.broadcast_arrays(origins, directions)
        found = self._scene.cast_single(origins, directions, beside=beside)
        return found.face, found.range_m
