"""Every rule, who in CARLA relies on it, and what of a package breaks it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from urbantwin.exports.carla.check import import_rules, road_rules, walking_rules
from urbantwin.exports.carla.check.finding import Finding, NoCarlaError, Problems
from urbantwin.exports.carla.check.read import Package, read_package
from urbantwin.extras import how_to_install

__all__ = ["NOT_PROVEN", "check_package", "findings"]

#: Rule, who reads it, and what finds its problems; or what is only good to know of the one before.
RULES: tuple[tuple[str, str, Callable[[Package], Problems], bool], ...] = (
    ("document and files", "Import.py", import_rules.document, False),
    ("FBX: version, unit, size", "Unreal's FBX import", import_rules.settings, False),
    ("names of meshes", "MoveAssets, Tagger.cpp", import_rules.meshes, False),
    ("materials", "PrepareAssetsForCooking", import_rules.materials, False),
    ("lanes without dead ends", "carla.Map, Traffic Manager", road_rules.lanes, False),
    ("lanes without dead ends", "carla.Map, Traffic Manager", road_rules.by_changing, True),
    ("waypoints over the mesh", "carla.Map", road_rules.on_mesh, False),
    ("waypoints over the mesh", "carla.Map", road_rules.heights, True),
    ("signals and signs", "TrafficLightManager.cpp", road_rules.signals, False),
    ("lanes of signals", "MapBuilder.cpp", road_rules.signal_lanes, False),
    ("controllers are stages", "TrafficLightGroup.cpp", road_rules.stages, False),
    ("lights stop at stop lines", "TrafficLightComponent.cpp", road_rules.stop_places, False),
    ("spawn points", "carla.Map", road_rules.spawn_points, False),
    ("where people walk", "RecastBuilder", walking_rules.navigation, False),
    ("crosswalks", "get_xodr_crosswalks.py", walking_rules.crosswalks, False),
    ("crosswalks", "RecastBuilder", walking_rules.without_sidewalk, True),
)
#: What needs a server or the Unreal editor.
NOT_PROVEN = (
    "the import in the Unreal editor, tags and materials there, the navigation that RecastBuilder "
    "makes, traffic, signals and sensors on a live server"
)


def check_package(folder: Path, *, python: str = sys.executable) -> tuple[Finding, ...]:
    """Apply the rules of CARLA 0.9.16's import, server and tools to every file of a package.

    Args:
        folder: what ``urbantwin export --to carla`` wrote.
        python: an interpreter with CARLA's package ``carla``; rules that need it are told as not
            applied where it has none.

    Raises:
        InputError: a file is missing or cannot be read.
    """
    return findings(read_package(folder, python))


def findings(package: Package) -> tuple[Finding, ...]:
    """Apply every rule to a package that was read."""
    found: list[Finding] = []
    for rule, reader, apply, told in RULES:
        try:
            said = tuple(apply(package))
        except NoCarlaError:
            if not told:
                found.append(Finding(rule, reader, missing=how_to_install("carla")))
            continue
        except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
            said = (f"it cannot be read ({type(error).__name__}: {error})",)
        if told:
            found[-1] = replace(found[-1], notes=said)
        else:
            found.append(Finding(rule, reader, said))
    return tuple(found)
