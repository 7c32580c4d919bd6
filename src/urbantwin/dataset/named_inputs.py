"""Inputs of a dataset's twin and motion by kind, and their warnings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["INPUT_KINDS", "named_inputs", "told_of"]

#: Description of each kind of input.
INPUT_KINDS = {
    "osm": "map (OpenStreetMap extract)",
    "sketch": "sketch of the streets",
    "roads": "map of the roads",
    "dem": "elevation model",
    "corrections": "corrections by hand",
    "street_objects": "street objects described by hand",
    "buildings": "footprints of buildings with heights",
    "geometry": "geometry (mesh, point cloud or 3D Tiles)",
    "recording": "real LiDAR frames of the static world",
    "imagery": "picture of the ground",
    "actor": "mesh of an actor",
    "footprints": "outlines of buildings",
    "control_points": "control points",
    "tracks": "recorded tracks of road users",
    "sensor": "description or calibration of a sensor",
    "background": "static world as real sensors measured it",
}
_UNSAID = {"licence": "not stated", "attribution": "not stated"}


def named_inputs(
    twin: Mapping[str, Any], motion: Mapping[str, Any], asked: Mapping[str, Any] | None
) -> list[dict[str, Any]]:
    """Return kind, name, SHA-256, licence and attribution of all inputs.

    Args:
        twin: manifest of the twin.
        motion: manifest of the motion.
        asked: requested rig, see `provenance.asked_of`.
    """
    made_from = twin.get("made_from") or {}
    inputs = [*twin["inputs"]]
    inputs += _beside(made_from.get("files", ()))
    inputs += _recorded(motion)
    if asked is not None:
        inputs += _beside(entry for entry in asked["files"] if entry.get("of") != "twin")
        inputs += [{"kind": "background", **_file(entry)} for entry in asked["background"]]
    unique = {(entry.get("kind"), entry["name"], entry.get("sha256")): entry for entry in inputs}
    return list(unique.values())


def told_of(twin: Mapping[str, Any], motion: Mapping[str, Any]) -> dict[str, Any]:
    """Return facts of the twin and motion for users who have the dataset alone.

    Args:
        twin: manifest of the twin.
        motion: manifest of the motion.

    Returns:
        ``place``, the twin's name; ``ground``, source of its heights; ``traffic``: requested,
        driven and seen actors by class, or the smoothing of recorded tracks; ``warnings`` of both.
    """
    ground = (twin.get("notes") or {}).get("ground") or {}
    recorded = motion.get("recorded")
    return {
        "place": twin.get("name"),
        "ground": ground.get("source"),
        "traffic": {
            "duration_s": motion.get("duration_s"),
            "classes": motion.get("classes"),
            "recorded": None if recorded is None else {"smoothing": recorded.get("smoothing")},
        },
        "warnings": {"twin": twin.get("warnings", []), "motion": motion.get("warnings", [])},
    }


def _beside(files: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the files of a site or a rig that are not inputs of the twin."""
    kinds = {"footprints": "footprints", "control_points": "control_points", "model": "sensor"}
    return [
        {"kind": kinds[entry["at"][-1]], **_file(entry)}
        for entry in files
        if entry["at"][-1] in kinds
    ]


def _recorded(motion: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the files of recorded tracks, with their terms."""
    description = motion.get("recorded")
    if not isinstance(description, Mapping):
        return []
    terms = {name: description[name] for name in _UNSAID if name in description}
    return [{"kind": "tracks", **_file(entry), **terms} for entry in description.get("files", ())]


def _file(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {"name": entry["name"], "sha256": entry["sha256"], **_UNSAID}
