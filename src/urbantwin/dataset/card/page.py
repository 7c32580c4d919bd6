"""``README.md`` of a dataset: its card, all of it from the manifest and the tables.

What a card tells follows Gebru et al. (2021), "Datasheets for Datasets", and Pushkarna et al.
(2022), "Data Cards"; the front matter is that of the Hugging Face Hub's dataset cards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from urbantwin.artefact import read_json, sha256_of
from urbantwin.artefact.manifest import Part, validated
from urbantwin.artefact.privacy import Finding
from urbantwin.dataset.card.licences import consequences, hub_licence, stated
from urbantwin.dataset.card.making import (
    durations_of,
    effects_of,
    mapping,
    mix_of,
    sensors_of,
    weather_of,
)
from urbantwin.dataset.card.statistics import BoxStatistics, ClassFigures
from urbantwin.dataset.named_inputs import INPUT_KINDS
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.dataset.split import image_sets
from urbantwin.pages import card
from urbantwin.result_warning import ResultWarning, warnings_of

__all__ = [
    "CARD",
    "EXPORTED",
    "PICTURES",
    "PICTURE_OF_SPLIT",
    "card_of_dataset",
    "card_of_export",
    "card_of_folder",
    "licences_told",
    "privacy_told",
]

#: Where hubs and people look first.
CARD = "README.md"
#: The picture that tells the split.
PICTURE_OF_SPLIT = "objects_per_frame.png"
#: Pictures in their order, and what they show.
PICTURES = {
    "birdseye.png": "A labelled frame from above: points by class, boxes with their headings",
    "range_image.png": "The same frame as a sensor sees it: ranges and classes",
    "scene.png": "The twin at that moment, with its traffic",
    "histogram.png": "Points per class; boxes per class, with and without points",
    "points_by_range.png": "Points on a box against its distance, by class",
    "box_sizes.png": "Length, width and height of the actors, by class",
    PICTURE_OF_SPLIT: "Boxes in each frame, by class, and which frames train",
    "places.png": "Where boxes with points are, in the site, from above",
}
#: Hubs' names of what it can be used for, by what a dataset always has.
_TASKS = ("object-detection", "image-segmentation", "other")
#: Least number of frames of each of the hub's categories of size.
_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (10**6, "100K<n<1M"))
_LARGEST = "1M<n<10M"
#: What of people may be in an input of a kind, and what of it comes into a dataset.
_REAL = {
    "tracks": "the paths, sizes and classes of road users (their clock and their names stay "
    "outside)",
    "background": "ranges of what stood still before real sensors",
    "recording": "points of what stood still before real sensors",
}
#: Frames of points and boxes, in words.
_FRAMES = {
    "level": "the first sensor's place and heading, z up",
    "sensor": "the sensor's own frame",
    "site": "the site's: east, north, up",
}
#: Phrase in the sensors' sources for a number that could not be checked at its source.
_UNCHECKED = "not at hand"


#: Kind of folder that an export of a dataset leaves.
EXPORTED = "exported"
_EXPECTED = "what `urbantwin export DATASET` writes"


class _Export(Part):
    format: str
    urbantwin: str
    dataset_sha256: str = ""
    inputs: list[dict[str, Any]] = Field(default_factory=list)
    losses: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


def card_of_dataset(
    folder: Path,
    statistics: BoxStatistics | None,
    private: Sequence[Finding] | None,
    beside: Path | None = None,
) -> str:
    """Return the card of a dataset as Markdown.

    Args:
        folder: the dataset's.
        statistics: of its boxes; None where it has no table of them.
        private: what was found of people in its files; None without a search.
        beside: where the card goes: pictures are shown that are in ``pictures/`` there; the
            dataset's folder if not given.

    Raises:
        InputError: its manifest or a list of frames is damaged.
    """
    manifest = read_manifest(folder)
    counts, place = manifest["counts"], _place(manifest)
    here = folder if beside is None else beside
    made = mapping(manifest, "made_from")
    boxes = counts["boxes"]
    seen = counts["boxes_with_points"]
    return card(
        "dataset/card/dataset.md.j2",
        manifest=manifest,
        mapping=mapping,
        front={
            "pretty_name": " ".join(place.split()),
            "license": hub_licence(manifest["inputs"]),
            "task_categories": list(_TASKS),
            "size_categories": [
                next((name for most, name in _SIZES if counts["frames"] < most), _LARGEST)
            ],
            "tags": ["lidar", "point-cloud", "3d-object-detection", "roadside", "synthetic"],
        },
        place=place,
        where=_where(manifest),
        pictures={
            name: shows for name, shows in PICTURES.items() if (here / "pictures" / name).is_file()
        },
        statistics=statistics,
        classes=_classes(boxes, seen, statistics),
        sensors=sensors_of(manifest),
        boxes=manifest["rig"].get("boxes", "track"),
        weather=weather_of(manifest["rig"]),
        effects=effects_of(manifest["rig"]),
        durations=durations_of(manifest),
        mix=mix_of(manifest),
        parts=_parts(folder, manifest, statistics),
        shared=_shared(manifest),
        stood=_rows(mapping(manifest, "split").get("where_they_stood")),
        files=_files(manifest),
        frame=_FRAMES.get(str(manifest["frame"]), manifest["frame"]),
        lacking=[name for name in ("twin", "motion", "record") if made.get(name) is None],
        versions={
            "urbantwin": manifest["urbantwin"],
            "Python": manifest.get("python", ""),
            **mapping(manifest, "dependencies"),
        },
        sha256=sha256_of(folder / "dataset.json"),
        warnings=_warnings(manifest),
        without=[name for name, count in boxes.items() if not count],
        unseen=[name for name, count in boxes.items() if count and not seen.get(name)],
        unchecked=_unchecked(manifest),
        **licences_told(manifest["inputs"]),
        **privacy_told(manifest["inputs"], private),
    )


def card_of_folder(folder: Path, datasets: Sequence[Path]) -> str:
    """Return the card of a folder with several datasets: a row and a link for each.

    Args:
        folder: where the card goes.
        datasets: folders of datasets in it.

    Raises:
        InputError: a manifest is damaged.
    """
    manifests = {one.relative_to(folder).as_posix(): read_manifest(one) for one in datasets}
    inputs = [row for one in manifests.values() for row in one["inputs"]]
    return card(
        "dataset/card/folder.md.j2",
        licence=hub_licence(inputs),
        place=next(map(_place, manifests.values()), ""),
        datasets=manifests,
    )


def card_of_export(folder: Path, private: Sequence[Finding] | None) -> str:
    """Return the card of an exported dataset as Markdown.

    Args:
        folder: what ``urbantwin export`` wrote.
        private: what was found of people in its files; None without a search.

    Raises:
        InputError: its manifest is damaged.
    """
    file = folder / f"{EXPORTED}.json"
    told = validated(read_json(file, kind=EXPORTED), _Export, file=file, expected=_EXPECTED)
    return card(
        "dataset/card/exported.md.j2",
        title=f"Simulated LiDAR frames of a street, as {told.format}",
        licence=hub_licence(told.inputs),
        told=told,
        file=file,
        sha256=sha256_of(file),
        **licences_told(told.inputs),
        **privacy_told(told.inputs, private),
    )


def licences_told(inputs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what ``licences.md.j2`` tells: every input with its terms, and what these ask."""
    return {
        "inputs": [
            {
                "what": INPUT_KINDS.get(str(one.get("kind")), one.get("kind") or "not told"),
                "name": one.get("name", ""),
                "licence": stated(one.get("licence")),
                "attribution": stated(one.get("attribution")),
                "sha256": str(one.get("sha256") or "")[:16],
            }
            for one in inputs
        ],
        "consequences": consequences(inputs),
    }


def privacy_told(
    inputs: Sequence[Mapping[str, Any]], private: Sequence[Finding] | None
) -> dict[str, Any]:
    """Return what came in of people, and what a search of the files found; not what it says."""
    kinds = {kind if isinstance(kind := one.get("kind"), str) else None for one in inputs}
    return {
        "kinds_known": None not in kinds,
        "real": [words for kind, words in _REAL.items() if kind in kinds],
        "private": private,
    }


def _place(manifest: Mapping[str, Any]) -> str:
    """Return what the place is called, or where it is."""
    site = mapping(manifest, "made_from", "twin", "made_from", "site")
    name = mapping(manifest, "about").get("place") or site.get("name")
    return str(name) if isinstance(name, str) and name.strip() else _where(manifest)


def _where(manifest: Mapping[str, Any]) -> str:
    anchor = mapping(manifest, "anchor")
    try:
        latitude, longitude = float(anchor["latitude"]), float(anchor["longitude"])
    except (KeyError, TypeError, ValueError):
        return "A place that is not told"
    return (
        f"{abs(latitude):.5f}° {'N' if latitude >= 0 else 'S'}, "
        f"{abs(longitude):.5f}° {'E' if longitude >= 0 else 'W'} (WGS84)"
    )


def _classes(
    boxes: Mapping[str, int], seen: Mapping[str, int], statistics: BoxStatistics | None
) -> list[ClassFigures]:
    if statistics is not None:
        return [statistics.figures(name) for name in statistics.names]
    return [ClassFigures(name, count, seen.get(name, 0)) for name, count in boxes.items() if count]


def _parts(
    folder: Path, manifest: Mapping[str, Any], statistics: BoxStatistics | None
) -> list[dict[str, Any]]:
    """Return each part of the split: its frames, when they are, its boxes."""
    times = {one["name"]: one["time_s"] for one in manifest["frames"]}
    rows = []
    for name, frames in image_sets(folder).items():
        when = [times[one] for one in frames if one in times]
        rows.append(
            {
                "name": name,
                "frames": len(frames),
                "span": f"{min(when):g} to {max(when):g} s" if when else None,
                "boxes": (None, None) if statistics is None else statistics.counted(frames),
            }
        )
    return rows


def _shared(manifest: Mapping[str, Any]) -> dict[str, list[tuple[str, Any, Any]]]:
    """Return what other parts of a split share with the one that trains: part, shared, of all."""
    told = mapping(manifest, "split")
    found = {}
    for words, name in (("Actors", "actors"), ("Parked vehicles", "parked")):
        counts = mapping(told, name)
        found[words] = [
            (part, counts[f"in train and {part}"], counts[part])
            for part in ("val", "test")
            if counts.get(part) and f"in train and {part}" in counts
        ]
    return found


def _files(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return each file of the layout, and what is in it."""
    rows = []
    for name, text in mapping(manifest, "layout").items():
        file, colon, content = str(text).partition(": ")
        if colon and name not in file and file.endswith(".txt"):
            file = f"{name}/{file}"
        rows.append((file, content) if colon else (name, str(text)))
    return rows


def _warnings(manifest: Mapping[str, Any]) -> list[tuple[str, ResultWarning]]:
    """Return the warnings of the dataset and of what it was made from, with the stage of each."""
    told = mapping(manifest, "about", "warnings")
    stages = {"dataset": manifest.get("warnings"), **{s: told.get(s) for s in ("twin", "motion")}}
    return [
        (stage, one) for stage, rows in stages.items() for one in warnings_of({"warnings": rows})
    ]


def _unchecked(manifest: Mapping[str, Any]) -> dict[str, dict[str, list[str]]]:
    """Return the unchecked and the unknown fields of each sensor model."""
    found = {}
    for one in manifest["rig"]["sensors"]:
        sources, unknown = (mapping(one["sensor"], key) for key in ("sources", "unknown"))
        unchecked = sorted(name for name, source in sources.items() if _UNCHECKED in str(source))
        if unchecked or unknown:
            found[str(one["model"])] = {"unchecked": unchecked, "unknown": sorted(unknown)}
    return found


def _rows(value: object) -> list[Mapping[str, Any]]:
    rows = value if isinstance(value, list) else []
    return [one for one in rows if isinstance(one, Mapping)]
