"""What a dataset says of its twin and its motion: every input by its kind, what was found wrong."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["INPUT_KINDS", "named_inputs", "told_of"]

#: What a kind of input is, in words.
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
    """Return kind, name, SHA-256, licence and attribution of all that people gave.

    Args:
        twin: the manifest of the twin.
        motion: the manifest of the motion.
        asked: what the rig was placed from, see `provenance.asked_of`.
    """
    made_from = twin.get("made_from") or {}
    found = [*twin["inputs"]]
    found += _beside(made_from.get("files", ()))
    found += _recorded(motion)
    if asked is not None:
        found += _beside(one for one in asked["files"] if one.get("of") != "twin")
        found += [{"kind": "background", **_file(one)} for one in asked["background"]]
    unique = {(one.get("kind"), one["name"], one.get("sha256")): one for one in found}
    return list(unique.values())


def told_of(twin: Mapping[str, Any], motion: Mapping[str, Any]) -> dict[str, Any]:
    """Return what who has the dataset alone would miss of its twin and its motion.

    Args:
        twin: the manifest of the twin.
        motion: the manifest of the motion.

    Returns:
        ``place``, the twin's name; ``ground``, where its heights are from; ``traffic``, by class
        how many were asked for, driven and seen, or how recorded tracks were smoothed;
        ``warnings`` of both.
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
    """Return the files of a site or a rig that none of the twin's inputs is."""
    kinds = {"footprints": "footprints", "control_points": "control_points", "model": "sensor"}
    return [{"kind": kinds[one["at"][-1]], **_file(one)} for one in files if one["at"][-1] in kinds]


def _recorded(motion: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the files of recorded tracks, with the terms that their description tells."""
    told = motion.get("recorded")
    if not isinstance(told, Mapping):
        return []
    terms = {name: told[name] for name in _UNSAID if name in told}
    return [{"kind": "tracks", **_file(one), **terms} for one in told.get("files", ())]


def _file(one: Mapping[str, Any]) -> dict[str, Any]:
    return {"name": one["name"], "sha256": one["sha256"], **_UNSAID}
