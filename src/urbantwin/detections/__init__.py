"""Detections: boxes with scores of any detector."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.detections.classes import (
        DETECTED_CLASSES,
        LARGE,
        MEMBERS,
        detected_class,
    )
    from urbantwin.detections.detections import Detections, joined
    from urbantwin.detections.folder import (
        check_detections_folder,
        put_detections,
        read_detections,
        write_detections,
    )
    from urbantwin.detections.semantic import read_semantic, write_semantic
    from urbantwin.detections.standing import frames_about, standing_places, without_standing

__all__ = [
    "DETECTED_CLASSES",
    "LARGE",
    "MEMBERS",
    "Detections",
    "check_detections_folder",
    "detected_class",
    "frames_about",
    "joined",
    "put_detections",
    "read_detections",
    "read_semantic",
    "standing_places",
    "without_standing",
    "write_detections",
    "write_semantic",
]

names_on_demand(__name__)
