"""A motion seen from a street corner: the twin is rendered once, and actors at each moment.

Rays are cast only inside the bounding rectangle of an actor, in its own frame on its asset's tree,
which is built once. An actor has the colour of its class, and casts its shadow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from urbantwin.dataset.motion_interpolation import Rows
from urbantwin.drawing import style
from urbantwin.drawing.film.signal_lamps import Lamps
from urbantwin.drawing.road_furniture import heads
from urbantwin.drawing.scene import Camera, clear_camera, render
from urbantwin.geometry import DownwardProbe, rotation_from_ypr
from urbantwin.geometry.rays import RayScene
from urbantwin.traffic.motion import Motion
from urbantwin.twin import Twin

__all__ = ["FromCorner", "corner_camera"]

#: Rays along each side of a pixel, for actors.
_FINER = 2
#: Elevations of the candidate cameras at a corner, seen from the junction, degrees.
_ELEVATIONS_DEG = (10.0, 13.0, 17.0, 22.0, 28.0, 36.0, 46.0)
_CORNER = Camera(distance_m=42.0, elevation_deg=_ELEVATIONS_DEG[0], field_deg=72.0)
#: Light of a face: ambient, and from the sun.
_AMBIENT, _SUN = 0.55, 0.6
#: Share of the light that remains in an actor's shadow.
_SHADED = 0.55
#: A lamp is hidden by surfaces closer to the camera by more than this, metres.
_OWN_HOUSING_M = 0.8
_LAMP_M = 0.16


def corner_camera(twin: Twin, middle: NDArray[np.float64]) -> Camera:
    """Return the camera near a place with the most of its streets visible.

    Args:
        twin: the twin.
        middle: (2,) middle of the view, site frame, metres.
    """
    above = np.array([[*middle, float(twin.mesh.vertices[:, 2].max()) + 1.0]])
    height = float(DownwardProbe(twin.ground_mesh).height_below(above)[0])
    target = (*middle, height if np.isfinite(height) else 0.0)
    return clear_camera(twin.mesh, target, usual=_CORNER, elevations_deg=_ELEVATIONS_DEG)


class FromCorner:
    """The view from a camera.

    Args:
        twin: the static scene.
        motion: motion with the actors' meshes and the signals.
        camera: the camera.
        size: width and height of the picture, pixels.
    """

    def __init__(self, twin: Twin, motion: Motion, camera: Camera, size: tuple[int, int]) -> None:
        width, height = size
        self._motion, self._camera, self._size = motion, camera, size
        static = render(
            twin.mesh, camera, width, height, surface=twin.surface_materials, colours=twin.colours
        )
        self._static = np.repeat(np.repeat(static, _FINER, axis=0), _FINER, axis=1)
        self._rays = camera.rays(width * _FINER, height * _FINER)
        scene = RayScene(twin.mesh.vertices, twin.mesh.faces)
        flat = self._rays.reshape(-1, 3)
        origins = np.tile(camera.place.astype(np.float32), (len(flat), 1))
        self._depth = scene.cast_single(origins, flat).range_m.reshape(self._rays.shape[:2])
        self._scenes: dict[tuple[str, int], tuple[RayScene, NDArray[np.float32]]] = {}
        self._lamps = self._heads(twin)

    def picture(
        self, rows: Rows, lamps: Lamps, time_s: float, marked: dict[int, str]
    ) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) of one moment; see `FromAbove.picture`."""
        colour, depth = self._static.copy(), self._depth.copy()
        for row in rows:
            self._shade_ground(row, colour)
        rings = []
        for row in rows:
            place = self._draw_actor(row, colour, depth)
            if place is not None and int(row["track"]) in marked:
                rings.append(place)
        width, height = self._size
        small = colour.reshape(height, _FINER, width, _FINER, 3)
        picture = Image.fromarray(np.asarray(small.mean(axis=(1, 3)) + 0.5, np.uint8))
        draw = ImageDraw.Draw(picture)
        shown = lamps.colours(time_s)
        for x, y, radius, distance, program, links in self._lamps:
            number = lamps.number(program, links)
            row, column = int(y * _FINER), int(x * _FINER)
            if number is None or depth[row, column] < distance - _OWN_HOUSING_M:
                continue
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=shown[number])
        for x0, y0, x1, y1 in rings:
            draw.rectangle((x0, y0, x1, y1), outline=style.ACCENT, width=2)
        return np.asarray(picture, np.uint8)

    def _draw_actor(
        self, row: np.void, colour: NDArray[np.uint8], depth: NDArray[np.float32]
    ) -> tuple[float, float, float, float] | None:
        """Draw an actor; return the rectangle around it, pixels, if it is in the picture."""
        where = self._rectangle(_corners(row))
        if where is None:
            return None
        part, around = where
        scene, normals = self._scene_of(str(row["asset"]), int(row["phase"]))
        turn = rotation_from_ypr(row["yaw"], row["pitch"], row["roll"])
        place = np.array([row["x"], row["y"], row["z"]])
        rays = self._rays[part].reshape(-1, 3)
        origin = ((self._camera.place - place) @ turn).astype(np.float32)
        local = np.ascontiguousarray(rays @ turn.astype(np.float32))
        found = scene.cast_single(np.tile(origin, (len(local), 1)), local)
        seen = np.flatnonzero(found.range_m < depth[part].ravel())
        if len(seen):
            facing = normals[found.face[seen]]
            facing *= -np.sign(np.einsum("ij,ij->i", facing, local[seen]))[:, None]
            sunny = np.maximum(facing @ (self._camera.sun @ turn).astype(np.float32), 0)
            base = 255 * style.actor_colour(str(row["class"]))
            lit = np.clip((_AMBIENT + _SUN * sunny)[:, None] * base, 0, 255).astype(np.uint8)
            rows, columns = np.divmod(seen, depth[part].shape[1])
            colour[part][rows, columns] = lit
            depth[part][rows, columns] = found.range_m[seen]
        return around

    def _shade_ground(self, row: np.void, colour: NDArray[np.uint8]) -> None:
        """Darken the area in an actor's shadow."""
        sun = self._camera.sun.astype(np.float64)
        corners = _corners(row)
        low = corners - sun * (float(row["height"]) / sun[2])
        where = self._rectangle(np.concatenate([corners[::2], low]))
        if where is None:
            return
        part, _ = where
        reach = self._depth[part].ravel()
        known = np.flatnonzero(np.isfinite(reach))
        rays = self._rays[part].reshape(-1, 3)[known]
        turn = rotation_from_ypr(row["yaw"], row["pitch"], row["roll"])
        place = np.array([row["x"], row["y"], row["z"]])
        hit = self._camera.place - place + rays * reach[known, None]
        scene, _ = self._scene_of(str(row["asset"]), int(row["phase"]))
        origins = np.ascontiguousarray(hit @ turn, np.float32)
        towards = np.tile((sun @ turn).astype(np.float32), (len(origins), 1))
        found = scene.cast_single(origins, towards)
        dark = known[np.isfinite(found.range_m)]
        rows, columns = np.divmod(dark, self._depth[part].shape[1])
        colour[part][rows, columns] = (colour[part][rows, columns] * _SHADED).astype(np.uint8)

    def _scene_of(self, asset: str, phase: int) -> tuple[RayScene, NDArray[np.float32]]:
        key = (asset, phase)
        if key not in self._scenes:
            mesh = self._motion.mesh(*key)
            scene = RayScene(mesh.vertices, mesh.faces)
            self._scenes[key] = scene, mesh.normals().astype(np.float32)
        return self._scenes[key]

    def _rectangle(
        self, points: NDArray[np.float64]
    ) -> tuple[tuple[slice, slice], tuple[float, float, float, float]] | None:
        """Return the finer pixels around points (N, 3), and their rectangle in the picture."""
        pixels, ahead = self._projected(points)
        if (ahead < 0.5).any():
            return None
        (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0)
        width, height = self._size
        if x1 < 0 or y1 < 0 or x0 >= width or y0 >= height:
            return None
        rows = slice(max(int(y0 * _FINER) - 1, 0), min(int(y1 * _FINER) + 2, height * _FINER))
        columns = slice(max(int(x0 * _FINER) - 1, 0), min(int(x1 * _FINER) + 2, width * _FINER))
        return (rows, columns), (float(x0), float(y0), float(x1), float(y1))

    def _projected(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return picture positions (N, 2) of points (N, 3), and their depth (N,), metres."""
        width, height = self._size
        forward = np.asarray(self._camera.target, np.float64) - self._camera.place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        way = points - self._camera.place
        ahead = way @ forward
        half = np.tan(np.radians(self._camera.field_deg) / 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = (way @ right / ahead / half + 1) * width / 2
            y = height / 2 - (way @ up / ahead / half) * width / 2
        return np.column_stack([x, y]), ahead

    def _heads(self, twin: Twin) -> list[tuple[float, float, float, float, str, tuple[int, ...]]]:
        """Return the heads that face the camera: position and size in the picture, and links."""
        known = [one for one in heads(twin.roads, twin.lane_model) if one.program]
        if not known:
            return []
        xy = np.array([(one.x, one.y) for one in known])
        top = np.full(len(xy), float(twin.mesh.vertices[:, 2].max()) + 1.0)
        ground = DownwardProbe(twin.ground_mesh).height_below(np.column_stack([xy, top]))
        z = np.nan_to_num(ground) + [one.z or 3.0 for one in known]
        places = np.column_stack([xy, z])
        pixels, ahead = self._projected(places)
        width, height = self._size
        half = np.tan(np.radians(self._camera.field_deg) / 2)
        found = []
        for one, place, (x, y), far in zip(known, places, pixels, ahead, strict=True):
            away = self._camera.place[:2] - place[:2]
            looks = -(np.cos(one.yaw) * away[0] + np.sin(one.yaw) * away[1])
            if far > 1 and 0 <= x < width and 0 <= y < height and looks > 0:
                radius = max(1.6, _LAMP_M / far / half * width / 2)
                distance = float(np.linalg.norm(place - self._camera.place))
                found.append((float(x), float(y), radius, distance, one.program, one.links))
        return found


def _corners(row: np.void) -> NDArray[np.float64]:
    """Return the corners (8, 3) of an actor's box, lower and upper in turn."""
    half = np.array([row["length"] / 2, row["width"] / 2])
    corners = [
        (x * half[0], y * half[1], z)
        for x in (-1, 1)
        for y in (-1, 1)
        for z in (0.0, float(row["height"]))
    ]
    turn = rotation_from_ypr(row["yaw"], row["pitch"], row["roll"])
    return np.asarray(corners @ turn.T + [row["x"], row["y"], row["z"]])
