"""Regions in which a recording is labelled: detections outside are neither right nor wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.artefact import read_json
from urbantwin.dataset.ignore_regions import IGNORE_REGIONS, read_ignore_regions
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.kitti import ALL_AROUND, read_calibration, read_regions
from urbantwin.fidelity.readers.tables import BOX_LIST
from urbantwin.geometry import Pose, box_corners, points_in_box

__all__ = ["View", "image_boxes", "view_of"]

#: Size of KITTI's images, pixels (Geiger et al. 2013); sizes vary by a few pixels.
_IMAGE = (1242.0, 375.0)
#: A box with more of its area in a ``DontCare`` region of the image is not judged.
_MOSTLY = 0.5
#: Points nearer to the image plane are behind the camera, metres.
_IN_FRONT_M = 0.1


class View(Protocol):
    """The region in which objects are labelled."""

    @property
    def said(self) -> str:
        """Description of the region."""

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask (N,) of the boxes (N, 7), in the frame of the points, in the region."""


def view_of(recording: Recording) -> View:
    """Return the region in which a recording's frames are labelled, as far as its layout shows.

    Raises:
        InputError: a file that defines the region is invalid.
    """
    if recording.layout == "kitti" and not (recording.path / ALL_AROUND).is_dir():
        return _CameraView(recording.path)
    if recording.layout == "own":
        return _Region(recording.path)
    if recording.layout == "waymo2":
        return _Zones()
    if recording.layout == "plain" and _folder(recording.path).joinpath(BOX_LIST).is_file():
        return _Extent()
    return _Everywhere()


def _folder(path: Path) -> Path:
    return path if path.is_dir() else path.parent


class _Everywhere:
    said = "everywhere"

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        del frame
        return np.ones(len(boxes), bool)


class _Extent:
    """The extent of each cropped cloud, as of LUMPI's frames, 40 m each way."""

    said = "within the extent of each frame's points in plan"

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        low, high = frame.points[:, :2].min(axis=0), frame.points[:, :2].max(axis=0)
        place = boxes[:, :2]
        return np.asarray(((place >= low) & (place <= high)).all(axis=1))


class _Zones:
    """Waymo: boxes without a point in a no-label zone."""

    said = "outside of Waymo's no-label zones"

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        found = np.ones(len(boxes), bool)
        if frame.unlabelled is None or not frame.unlabelled.any():
            return found
        points = frame.points[frame.unlabelled]
        for index, box in enumerate(boxes):
            found[index] = not points_in_box(points, box).any()
        return found


class _Region:
    """Our datasets: outside of their ignore regions, up to the range of their labels."""

    said = "outside of ignore_regions.geojson, as far as labels go"

    def __init__(self, path: Path) -> None:
        areas: Sequence[shapely.MultiPolygon] = ()
        if (path / IGNORE_REGIONS).is_file():
            areas = [one.area for one in read_ignore_regions(path / IGNORE_REGIONS)]
        self._ignored = shapely.union_all(list(areas)) if areas else None
        if self._ignored is not None:
            shapely.prepare(self._ignored)
        self._most_m: float | None = None
        if (path / "dataset.json").is_file():
            rig = read_json(path / "dataset.json", kind="dataset").get("rig")
            told = rig.get("label_range_m") if isinstance(rig, dict) else None
            self._most_m = float(told) if isinstance(told, int | float) else None

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        found = np.ones(len(boxes), bool)
        if self._ignored is not None:
            pose = frame.world_SE3_frame
            place = boxes[:, :3] if pose is None else pose.apply(boxes[:, :3])
            x, y, _ = place.T
            found &= ~shapely.contains_xy(self._ignored, x, y)
        if self._most_m is not None:
            away = boxes[:, None, :2] - frame.sensor_places[None, :, :2]
            found &= np.hypot(*away.transpose(2, 0, 1)).min(axis=1) <= self._most_m
        return found


@dataclass(frozen=True)
class _CameraView:
    """KITTI: the image of the left colour camera without its ``DontCare`` regions."""

    path: Path
    said: str = "in the image of KITTI's left colour camera, outside of its DontCare regions"

    def covers(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        file = self.path / "calib" / f"{frame.name}.txt"
        calibration = read_calibration(file)
        if calibration.projection is None:
            return np.ones(len(boxes), bool)
        pixels, ahead = _projected(
            boxes[:, :3], calibration.camera_SE3_lidar, calibration.projection
        )
        found = ahead & ((pixels >= 0) & (pixels <= _IMAGE)).all(axis=1)
        regions = read_regions(self.path / "label_2" / f"{frame.name}.txt")
        if not len(regions):
            return np.asarray(found)
        inside = np.flatnonzero(found)
        seen = image_boxes(boxes[inside], calibration.camera_SE3_lidar, calibration.projection)
        low = np.maximum(seen[:, None, :2], regions[None, :, :2])
        high = np.minimum(seen[:, None, 2:], regions[None, :, 2:])
        common = np.maximum(high - low, 0).prod(axis=2)
        area = np.maximum((seen[:, 2:] - seen[:, :2]).prod(axis=1), 1e-9)
        found[inside] &= ~(common > _MOSTLY * area[:, None]).any(axis=1)
        return np.asarray(found)


def image_boxes(
    boxes: NDArray[np.float64],
    camera_SE3_lidar: Pose,
    projection: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return left, top, right, bottom (N, 4) in pixels of boxes (N, 7), clipped to the image."""
    found = np.zeros((len(boxes), 4))
    if not len(boxes):
        return found
    corners = np.concatenate([box_corners(box) for box in boxes])
    pixels, ahead = _projected(corners, camera_SE3_lidar, projection)
    pixels, ahead = pixels.reshape(-1, 8, 2), ahead.reshape(-1, 8)
    seen = ahead.any(axis=1)
    found[seen, :2] = np.where(ahead[..., None], pixels, np.inf)[seen].min(axis=1)
    found[seen, 2:] = np.where(ahead[..., None], pixels, -np.inf)[seen].max(axis=1)
    found[:, ::2] = found[:, ::2].clip(0, _IMAGE[0])
    found[:, 1::2] = found[:, 1::2].clip(0, _IMAGE[1])
    return found


def _projected(
    points: NDArray[np.float64], camera_SE3_lidar: Pose, projection: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return pixels (N, 2) of points (N, 3) in the sensor frame, and the mask of those in front."""
    seen = camera_SE3_lidar.apply(points)
    image = seen @ projection[:, :3].T + projection[:, 3]
    ahead = seen[:, 2] > _IN_FRONT_M
    depth = np.where(ahead, image[:, 2], 1.0)
    return image[:, :2] / depth[:, None], np.asarray(ahead)
