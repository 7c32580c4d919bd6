"""Output of an explanation: ``explanation.json``, tables, a picture per object, a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.pages import write_page
from urbantwin.progress import Progress, each
from urbantwin.studies.causes.changes import LOST, WON, Change, Comparison
from urbantwin.studies.causes.picture import draw_change
from urbantwin.studies.causes.reasons import FEWER, REASONS

__all__ = ["KIND", "write_explanation"]

KIND = "explanation"


def write_explanation(
    folder: Path,
    compared: Sequence[Comparison],
    told: Mapping[str, Any],
    *,
    least: Mapping[str, float],
    most: int,
    tell: Progress,
) -> dict[str, Any]:
    """Write all outputs of an explanation into a folder.

    Args:
        folder: the folder.
        compared: comparison of each variant with the base.
        told: factor, names, settings.
        least: lowest score of a detection that counts, by class.
        most: largest number of drawn objects, those with most points first.
        tell: called with the fraction done and a description.

    Returns:
        Content of ``explanation.json``.
    """
    pictures = _pictures(folder, compared, least, most, tell)
    rows = [
        _row(one, change, pictures.get((one.variant.name, change.track, change.way)))
        for one in compared
        for change in one.changes
    ]
    _write_table(folder / "changes", rows)
    variants = {one.variant.name: _counts(one) for one in compared}
    objects = {(one.variant.name, x.track, x.way) for one in compared for x in one.changes}
    report: dict[str, Any] = {
        "kind": KIND,
        "schema": 1,
        **told,
        "in_short": _in_short(variants),
        "scores": dict(least),
        "variants": variants,
        "objects": len(objects),
        "drawn": len(pictures),
        "reasons": dict(REASONS),
        "warnings": [],
    }
    write_page(
        folder / f"{KIND}.html",
        "studies/causes/page.html.j2",
        report=report,
        rows=rows,
        ways=(LOST, WON),
        fewer=FEWER,
        pictures={title: folder / name for title, name in _shown(rows, pictures)},
    )
    written: dict[str, Any] = as_json(report)
    write_json(folder / f"{KIND}.json", written)
    return written


def _pictures(
    folder: Path,
    compared: Sequence[Comparison],
    least: Mapping[str, float],
    most: int,
    tell: Progress,
) -> dict[tuple[str, int, str], str]:
    """Draw each changed object once, in its frame with most points; return file names."""
    best: dict[tuple[str, int, str], tuple[int, Comparison, Change]] = {}
    for one in compared:
        for change in one.changes:
            key = one.variant.name, change.track, change.way
            points = max(change.points)
            if key not in best or points > best[key][0]:
                best[key] = points, one, change
    drawn = sorted(best.items(), key=lambda item: (-item[1][0], item[0]))[:most]
    if drawn:
        (folder / "pictures").mkdir()
    names = {}
    for number, (key, (_, one, change)) in enumerate(each(drawn, tell, "pictures")):
        names[key] = f"pictures/{number + 1:03}-{change.actor}-{change.track}.png"
        draw_change(change, one, least, folder / names[key])
    return names


def _row(one: Comparison, change: Change, picture: str | None) -> dict[str, Any]:
    return {
        "variant": one.variant.name,
        "frame": change.frame,
        "time_s": change.time_s,
        "track": change.track,
        "class": change.actor,
        "change": change.way,
        "reason": change.reason.reason,
        "by": change.reason.by,
        "by_track": change.reason.by_track,
        "why": change.reason.told,
        "detector": change.said.reason,
        "detector_said": change.said.told,
        "detector_score": change.said.score,
        "detector_off_m": change.said.off_m,
        "found_with_score": change.score,
        "points_base": change.points[0],
        "points_variant": change.points[1],
        "points_alone_base": change.alone[0],
        "points_alone_variant": change.alone[1],
        "picture": picture,
    }


def _counts(one: Comparison) -> dict[str, Any]:
    """Return the number of changed objects, by direction and reason."""
    told: dict[str, Any] = {
        "found_in_both": one.both,
        "missed_in_both": one.neither,
        "on_one_side_only": one.apart,
    }
    for way in (LOST, WON):
        mine = Counter(change.reason.reason for change in one.changes if change.way == way)
        told[way] = {reason: mine[reason] for reason in REASONS if mine[reason]}
    return told


def _in_short(variants: Mapping[str, Mapping[str, Any]]) -> str:
    parts = []
    for name, told in variants.items():
        lost, won = sum(told[LOST].values()), sum(told[WON].values())
        why = ", ".join(f"{count} {reason}" for reason, count in told[LOST].items())
        parts.append(
            f"{name}: {lost} found to missed{f' ({why})' if why else ''}, {won} missed to found"
        )
    return "; ".join(parts) + "."


def _write_table(stem: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    import pyarrow as pa

    text, whole, number = pa.string(), pa.int64(), pa.float64()
    schema = pa.schema(
        [
            *(("variant", text), ("frame", text), ("time_s", number), ("track", whole)),
            *(("class", text), ("change", text), ("reason", text), ("by", text)),
            *(("by_track", whole), ("why", text), ("detector", text), ("detector_said", text)),
            *(("detector_score", number), ("detector_off_m", number)),
            *(("found_with_score", number), ("points_base", whole), ("points_variant", whole)),
            *(("points_alone_base", whole), ("points_alone_variant", whole), ("picture", text)),
        ]
    )
    table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
    write_parquet_and_csv(stem, table)


def _shown(
    rows: Sequence[Mapping[str, Any]], pictures: Mapping[tuple[str, int, str], str]
) -> Iterator[tuple[str, str]]:
    """Yield the title of each picture, with the reasons over all its frames, and its file."""
    for key, name in pictures.items():
        mine = [row for row in rows if (row["variant"], row["track"], row["change"]) == key]
        why = "; ".join(
            f"{reason} in {count} frame{'s' * (count != 1)}"
            for reason, count in Counter(row["reason"] for row in mine).items()
        )
        variant, track, way = key
        yield f"{mine[0]['class']} {track}, {way} ({variant}): {why}", name
