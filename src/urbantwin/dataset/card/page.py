"""``README.md`` of a dataset: its card, all of it from the manifest and the tables.

What a card tells follows Gebru et al. (2021), "Datasheets for Datasets", and Pushkarna et al.
(2022), "Data Cards"; the front matter is that of the Hugging Face Hub's dataset cards.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from urbantwin.artefact import sha256_of
from urbantwin.artefact.markdown import bullets, code, escaped, front_matter, picture, table
from urbantwin.artefact.privacy import Finding
from urbantwin.dataset.card.licences import consequences, hub_licence, stated
from urbantwin.dataset.card.limits import limits_of, unchecked_numbers
from urbantwin.dataset.card.making import making_of, mapping
from urbantwin.dataset.card.statistics import BoxStatistics, ClassFigures
from urbantwin.dataset.named_inputs import INPUT_KINDS
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.dataset.split import image_sets

__all__ = [
    "CARD",
    "PICTURES",
    "PICTURE_OF_SPLIT",
    "card_of_dataset",
    "card_of_folder",
    "joined",
    "licence_lines",
    "privacy_lines",
    "section",
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
        private: what was found of people in its files; None where nobody looked.
        beside: where the card goes: pictures are shown that are in ``pictures/`` there; the
            dataset's folder if not given.

    Raises:
        InputError: its manifest or a list of frames is damaged.
    """
    manifest = read_manifest(folder)
    place = _place(manifest)
    return joined(
        _front(place, manifest),
        [f"# {escaped(place)}", "", _summary(manifest)],
        section("Pictures", _pictures(folder if beside is None else beside)),
        section("Classes", [*_classes(manifest, statistics), *_levels(statistics)]),
        section("Points", _points(manifest)),
        *(section(title, lines) for title, lines in making_of(manifest)),
        section("Split", _split(folder, manifest, statistics)),
        section("Files", _files(manifest)),
        section("How to load it", _loading()),
        section("How it can be made again", _reproducing(folder, manifest)),
        section("Inputs, licences and attribution", licence_lines(manifest["inputs"])),
        section("Personal data", privacy_lines(manifest["inputs"], private)),
        section("Known limits", _limits(manifest)),
    )


def card_of_folder(folder: Path, datasets: Sequence[Path]) -> str:
    """Return the card of a folder with several datasets: a row and a link for each.

    Args:
        folder: where the card goes.
        datasets: folders of datasets in it.

    Raises:
        InputError: a manifest is damaged.
    """
    rows, inputs, place = [], [], ""
    for one in datasets:
        manifest = read_manifest(one)
        name = one.relative_to(folder).as_posix()
        inputs += manifest["inputs"]
        place = place or _place(manifest)
        counts = manifest["counts"]
        models = ", ".join(code(unit["model"]) for unit in manifest["rig"]["sensors"])
        link = f"[{escaped(name)}]({quote(name)}/{CARD})"
        boxes = sum(counts["boxes"].values())
        rows.append([link, models, counts["frames"], counts["points"], boxes])
    lines = [
        *front_matter({"license": hub_licence(inputs), "pretty_name": place}),
        "",
        f"# {escaped(place)}",
        "",
        *table(["dataset", "sensors", "frames", "points", "boxes"], rows, 3),
    ]
    return "\n".join(lines) + "\n"


def joined(*parts: Iterable[str]) -> str:
    """Return the text of parts of a card, each of some lines."""
    return "\n".join(line for part in parts for line in part).rstrip() + "\n"


def section(title: str, lines: Sequence[str]) -> list[str]:
    """Return lines of a card under a title; none where there are none."""
    return ["", f"## {title}", "", *lines] if lines else []


def _front(place: str, manifest: Mapping[str, Any]) -> list[str]:
    frames = manifest["counts"]["frames"]
    size = next((name for most, name in _SIZES if frames < most), _LARGEST)
    return [
        *front_matter(
            {
                "pretty_name": " ".join(place.split()),
                "license": hub_licence(manifest["inputs"]),
                "task_categories": list(_TASKS),
                "size_categories": [size],
                "tags": ["lidar", "point-cloud", "3d-object-detection", "roadside", "synthetic"],
            }
        ),
        "",
    ]


def _summary(manifest: Mapping[str, Any]) -> str:
    counts, rig = manifest["counts"], manifest["rig"]
    times = [frame["time_s"] for frame in manifest["frames"]]
    boxes, seen = (sum(counts[name].values()) for name in ("boxes", "boxes_with_points"))
    rides = " that ride on a vehicle" if manifest["dataset_SE3_site"] is None else ""
    units = ", ".join(code(one["model"]) for one in rig["sensors"])
    frames = f"{counts['frames']:,} frame{'' if counts['frames'] == 1 else 's'}"
    return (
        f"Simulated LiDAR frames of a street, with 3D boxes, tracks, and a class and an instance "
        f"for every point. {frames} from {times[0]:g} to {times[-1]:g} s of one drive, by {units}"
        f"{rides}: {counts['points']:,} points and {boxes:,} boxes, "
        f"{seen:,} of them with points. {_where(manifest)}. "
        f"Made by UrbanTwin {escaped(manifest['urbantwin'])}."
    )


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


def _pictures(folder: Path) -> list[str]:
    there = [name for name in PICTURES if (folder / "pictures" / name).is_file()]
    lines = []
    for name in there:
        lines += [picture(f"pictures/{name}", PICTURES[name]), "", f"*{PICTURES[name]}.*", ""]
    return lines[:-1]


def _classes(manifest: Mapping[str, Any], statistics: BoxStatistics | None) -> list[str]:
    counts = manifest["counts"]
    figures = [
        ClassFigures(name, count, counts["boxes_with_points"].get(name, 0))
        for name, count in counts["boxes"].items()
        if count
    ]
    if statistics is not None:
        figures = [statistics.figures(name) for name in statistics.names]
    heading = ["class", "boxes", "with points", "tracks", "seen", "length", "width", "height"]
    heading += ["points", "distance"]
    rows: list[list[object]] = []
    for one in figures:
        sizes = [None] * 3 if one.size_m is None else [f"{side:.2f}" for side in one.size_m]
        points = None if one.points is None else f"{one.points:.0f}"
        away = None if one.range_m is None else f"{one.range_m:.0f}"
        rows.append(
            [code(one.name), one.boxes, one.with_points, one.tracks, one.seen_tracks]
            + [*sizes, points, away]
        )
    return [
        *table(heading, rows, len(heading) - 1),
        "",
        "Of tracks: how many actors, how many of them have a point in any frame, and the median of "
        "their sizes in metres. Points on a box and its distance from the nearest sensor in "
        "metres: medians of the boxes with points.",
    ]


def _levels(statistics: BoxStatistics | None) -> list[str]:
    """Return how hard the boxes are to find, where the dataset says it."""
    lines: list[str] = []
    if statistics is None:
        return lines
    for counts, words in (
        (statistics.difficulty, "Difficulty of the boxes that count"),
        (statistics.ignored, "Boxes that do not count, and why"),
    ):
        if counts:
            told = ", ".join(f"{code(name)} {count:,}" for name, count in counts.items())
            lines += ["", f"{words}: {told}."]
    return lines


def _points(manifest: Mapping[str, Any]) -> list[str]:
    counts = manifest["counts"]["points_by_class"]
    total = max(sum(counts.values()), 1)
    rows = [
        [code(name), count, f"{count / total:.2%}"]
        for name, count in sorted(counts.items(), key=lambda one: (-one[1], one[0]))
    ]
    return table(["class of points", "points", "share"], rows, 2)


def _split(
    folder: Path, manifest: Mapping[str, Any], statistics: BoxStatistics | None
) -> list[str]:
    splits = image_sets(folder)
    times = {one["name"]: one["time_s"] for one in manifest["frames"]}
    rows: list[list[object]] = []
    for name, frames in splits.items():
        when = [times[one] for one in frames if one in times]
        span = f"{min(when):g} to {max(when):g} s" if when else None
        boxes = (None, None) if statistics is None else statistics.counted(frames)
        rows.append([code(name), len(frames), span, *boxes])
    told = manifest.get("split")
    lines = table(["split", "frames", "time", "boxes", "with points"], rows, 2)
    if isinstance(told, Mapping):
        return [*lines, "", *bullets(_how_split(told))]
    how = mapping(manifest, "layout").get("ImageSets")
    return [*lines, "", f"{escaped(how)}."] if how else lines


def _how_split(told: Mapping[str, Any]) -> list[str]:
    """Return how frames were divided, and what the parts share all the same."""
    gap, lost = told.get("gap_s"), told.get("frames_in_gaps")
    how = f"By {escaped(told.get('by'))}"
    if isinstance(gap, int | float):
        how += f", with a gap of {gap:g} s between the parts"
    lines = [f"{how}; {lost} frames are in no part." if isinstance(lost, int) else f"{how}."]
    if told.get("why"):
        lines.append(escaped(told["why"]))
    for name in ("actors", "parked"):
        counts = mapping(told, name)
        shared = [
            f"{counts[f'in train and {part}']} of {counts[part]} in `{part}`"
            for part in ("val", "test")
            if counts.get(part) and f"in train and {part}" in counts
        ]
        if shared:
            kind = "Actors" if name == "actors" else "Parked vehicles"
            lines.append(f"{kind} that `train` shows, too: {', '.join(shared)}.")
    stood = told.get("where_they_stood")
    lines += [
        f"Of {one.get('moving')} moving actors {one.get('still')} stand in {code(one.get('to'))} "
        f"where they stood in {code(one.get('from'))}."
        for one in (stood if isinstance(stood, list) else [])
        if isinstance(one, Mapping)
    ]
    return lines


def _files(manifest: Mapping[str, Any]) -> list[str]:
    layout = mapping(manifest, "layout")
    frame = {
        "level": "the first sensor's place and heading, z up",
        "sensor": "the sensor's own frame",
        "site": "the site's: east, north, up",
    }.get(str(manifest["frame"]), escaped(manifest["frame"]))
    rows = []
    for name, text in layout.items():
        file, colon, content = str(text).partition(": ")
        if colon and name not in file and file.endswith(".txt"):
            file = f"{name}/{file}"
        rows.append([code(file if colon else name), escaped(content if colon else text)])
    return [
        *table(["file", "content"], rows),
        "",
        f"Lengths in metres, angles in radians, times in seconds. Frame of points and boxes: "
        f"{frame}; `dataset.json` has the pose that takes the site to it (`dataset_SE3_site`). "
        "Site: metres east, north and up from the anchor. Boxes: centre, length, width, height, "
        "yaw counter-clockwise from x.",
    ]


def _loading() -> list[str]:
    return [
        "```python",
        "import urbantwin as ut  # pip install urbantwin",
        'frame = ut.open("dataset/")[0]',
        "frame.points, frame.semantic, frame.instance, frame.boxes",
        "```",
        "",
        "Without it, `points/` and `labels/` are what OpenPCDet's custom dataset reads, "
        "`semantic/` is of SemanticKITTI's form.",
    ]


def _reproducing(folder: Path, manifest: Mapping[str, Any]) -> list[str]:
    made = mapping(manifest, "made_from")
    lacking = [name for name in ("twin", "motion", "record") if made.get(name) is None]
    if mapping(manifest, "about", "traffic").get("recorded") is not None:
        first = (
            "`urbantwin traffic replay` of the recorded tracks and `urbantwin record`, with the "
            "inputs below and these seeds: `urbantwin dataset reproduce` does not know tracks."
        )
    elif lacking:
        first = (
            f"It cannot: its {' and its '.join(lacking)} did not come from UrbanTwin's own "
            "commands and files alone."
        )
    else:
        first = (
            "`urbantwin dataset reproduce dataset.json --inputs FOLDER`, with the inputs below in "
            "FOLDER."
        )
    seeds = ", ".join(f"{escaped(name)} {seed}" for name, seed in manifest["seeds"].items())
    versions = ", ".join(
        f"{escaped(name)} {escaped(one)}"
        for name, one in {
            "urbantwin": manifest["urbantwin"],
            "Python": manifest.get("python", ""),
            **mapping(manifest, "dependencies"),
        }.items()
        if one
    )
    return [
        first,
        "",
        *bullets(
            [
                f"Seeds: {seeds}.",
                f"Versions: {versions}.",
                f"SHA-256 of `dataset.json`, which has those of the frames and tables: "
                f"`{sha256_of(folder / 'dataset.json')}`. `SHA256SUMS` has every file's; "
                "`urbantwin dataset verify .` compares them.",
            ]
        ),
    ]


def licence_lines(inputs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return every input with its terms, and what these ask of who passes on what came of it."""
    if not inputs:
        return ["No input of anybody's is named in `dataset.json`."]
    rows = [
        [
            escaped(INPUT_KINDS.get(str(one.get("kind")), one.get("kind") or "not told")),
            code(one.get("name", "")),
            escaped(stated(one.get("licence")) or "not stated"),
            escaped(stated(one.get("attribution")) or "not stated"),
            code(str(one.get("sha256") or "")[:16]) or "-",
        ]
        for one in inputs
    ]
    return [
        *table(["what", "name", "licence", "attribution", "SHA-256 begins"], rows),
        "",
        "What the licences ask of who passes on what was made from these inputs, in short (their "
        "texts count):",
        "",
        *bullets(f"**{escaped(name)}**: {escaped(text)}." for name, text in consequences(inputs)),
    ]


def privacy_lines(
    inputs: Sequence[Mapping[str, Any]], private: Sequence[Finding] | None
) -> list[str]:
    """Return what came in of people, and what a search of the files found; not what it says."""
    kinds = {kind if isinstance(kind := one.get("kind"), str) else None for one in inputs}
    real = [words for kind, words in _REAL.items() if kind in kinds]
    came = f"Of real recordings came in: {'; '.join(real)}." if real else "Nobody was recorded."
    named = f"{came} Every input is named above with its kind."
    if None in kinds:
        named = (
            "Every input is named above; of which kind each is, the manifest of an earlier version "
            "does not say, so it does not tell whether real recordings came in."
        )
    lines = [f"The frames are simulated. {named}", ""]
    if private is None:
        return [*lines, "Nobody searched the files for personal data."]
    if not private:
        return [
            *lines,
            "The files were searched for absolute paths, home folders, names of users and "
            "machines, e-mail addresses and time stamps: nothing was found. "
            "`urbantwin dataset verify . --privacy` searches again, also for your own machine's "
            "names.",
        ]
    rows = [[code(one.file), escaped(one.place), escaped(one.what)] for one in private[:20]]
    more = ["", f"And {len(private) - 20:,} more."] if len(private) > 20 else []
    return [
        *lines,
        f"The files were searched; {len(private):,} places may say something of people:",
        "",
        *table(["file", "place", "what"], rows),
        *more,
    ]


def _limits(manifest: Mapping[str, Any]) -> list[str]:
    lines = bullets(limits_of(manifest))
    for model, unchecked, unknown in unchecked_numbers(manifest):
        said = []
        if unchecked:
            said.append(f"as published, but not checked again: {', '.join(map(code, unchecked))}")
        if unknown:
            said.append(f"not known: {', '.join(map(code, unknown))}")
        lines.append(f"- Numbers of the {escaped(model)}: {'; '.join(said)}.")
    return lines
