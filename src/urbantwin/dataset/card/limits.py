"""What is known to be wrong or unproven about a dataset: warnings, guesses, unchecked numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from urbantwin.artefact.markdown import code, escaped
from urbantwin.dataset.card.making import mapping
from urbantwin.result_warning import ResultWarning, warnings_of

__all__ = ["limits_of", "unchecked_numbers"]

#: How the sensors' sources say that nobody could look the number up again.
_UNCHECKED = "not at hand"
#: What holds for every dataset that is simulated; README.md tells more.
_ALWAYS = (
    "Everything in it is simulated: a detector that was judged on it alone was not judged on "
    "reality. `urbantwin compare REAL DATASET` measures how near its frames come to real ones.",
    "Mirror images, in panes and in wet ground, are not followed; beams leave a sensor from one "
    "point.",
    "Most reflectivities of materials are estimates.",
)
_OF_MAPS = (
    "Of a map alone, buildings have mapped or guessed heights, roofs and storeys and usual "
    "windows; what nobody mapped or surveyed is not there, and furniture that the map only hints "
    "at is set at random."
)


def limits_of(manifest: Mapping[str, Any]) -> list[str]:
    """Return what is known to be wrong or unproven, as lines of Markdown."""
    about = mapping(manifest, "about")
    found = [_warning("dataset", one) for one in warnings_of(manifest)]
    for stage in ("twin", "motion"):
        told = {"warnings": mapping(about, "warnings").get(stage)}
        found += [_warning(stage, one) for one in warnings_of(told)]
    found += _of_classes(manifest)
    ground = about.get("ground")
    if isinstance(ground, str):
        found.append(f"Ground: {escaped(ground)}.")
    if mapping(manifest, "made_from", "motion", "asked").get("guessed"):
        found.append("The demand of traffic is a guess from the map, not counted.")
    if any(one.get("kind") in ("osm", "roads", "sketch") for one in manifest.get("inputs", [])):
        found.append(_OF_MAPS)
    return [*found, *_ALWAYS]


def unchecked_numbers(manifest: Mapping[str, Any]) -> list[tuple[str, list[str], list[str]]]:
    """Return of each model of sensor the fields nobody could check, and those not known."""
    found = {}
    for one in manifest["rig"]["sensors"]:
        sensor = one["sensor"]
        sources = _texts(sensor.get("sources"))
        unchecked = sorted(name for name, source in sources if _UNCHECKED in source)
        unknown = sorted(name for name, _ in _texts(sensor.get("unknown")))
        found[str(one["model"])] = (str(one["model"]), unchecked, unknown)
    return [one for one in found.values() if one[1] or one[2]]


def _of_classes(manifest: Mapping[str, Any]) -> Iterator[str]:
    counts = manifest["counts"]
    without = [name for name, count in counts["boxes"].items() if not count]
    unseen = [
        name
        for name, count in counts["boxes"].items()
        if count and not counts["boxes_with_points"].get(name)
    ]
    if without:
        yield f"No box of {', '.join(map(code, without))}: nothing can be learned of them here."
    if unseen:
        yield f"No box of {', '.join(map(code, unseen))} has a point."


def _warning(stage: str, one: ResultWarning) -> str:
    return f"Warning of the {stage}: {escaped(one)}"


def _texts(value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        yield from ((str(name), str(text)) for name, text in value.items())
