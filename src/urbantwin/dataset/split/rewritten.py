"""A new split of existing datasets, whose frames stay as they are."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import check_folder, replaced_folder, sha256_of, write_inventory, write_json
from urbantwin.artefact.inventory import INVENTORY, read_inventory
from urbantwin.dataset.card.write import renew_cards, told_of
from urbantwin.dataset.manifest import LAYOUT
from urbantwin.dataset.split.asked import SplitAsked
from urbantwin.dataset.split.image_sets import FILES, write_image_sets
from urbantwin.dataset.split.scenarios import Scenario
from urbantwin.dataset.split.sources import Source
from urbantwin.dataset.split.time_split import Split, split_in_time, warnings_of_split
from urbantwin.errors import InputError
from urbantwin.progress import Progress, each
from urbantwin.result_warning import rows_of

__all__ = ["split_datasets_in_time"]


def split_datasets_in_time(
    scenarios: Sequence[Scenario],
    asked: SplitAsked,
    tell: Progress,
    redraw: Callable[[Path], None],
) -> dict[Path, dict[str, Any]]:
    """Split datasets in time, those of one scenario at the same moments, and rewrite their lists.

    Each dataset is replaced as a whole: its lists, manifest, card and inventory always agree.

    Args:
        scenarios: the datasets, see `scenarios_of`.
        asked: shares, gap and thinning.
        tell: called with the fraction done.
        redraw: draws the picture of a dataset's split; see `renew_cards`.

    Returns:
        Description of the split in each manifest, by folder.

    Raises:
        InputError: a dataset is part of another, is damaged or cannot be written, or a gap leaves a
            part without a frame.
    """
    for one in (source for scenario in scenarios for source in scenario.sources):
        _check(one)
    splits = [
        split_in_time([part for source in one.sources for part in source.recorded], asked)
        for one in scenarios
    ]
    pairs = [
        (source, split)
        for scenario, split in zip(scenarios, splits, strict=True)
        for source in scenario.sources
    ]
    told = {}
    for source, split in each(pairs, tell, "writing"):
        told[source.folder] = _rewrite(source, split, asked, redraw)
    return told


def _check(source: Source) -> None:
    """Check that a dataset can be rewritten.

    Raises:
        InputError: it cannot.
    """
    check_folder(source.folder, kind="dataset")
    if not (source.folder / INVENTORY).is_file():
        raise InputError(
            "holds no inventory", file=source.folder, expected=f"a dataset with {INVENTORY}"
        )
    for name in read_inventory(source.folder):
        if not (source.folder / name).is_file():
            raise InputError("not found", file=source.folder / name, expected="a whole dataset")


def _rewrite(
    source: Source, split: Split, asked: SplitAsked, redraw: Callable[[Path], None]
) -> dict[str, Any]:
    sums = read_inventory(source.folder)
    told: dict[str, Any] = {}
    with replaced_folder(source.folder, kind="dataset") as folder:
        for name in sums:
            _link(source.folder / name, folder / name)
        changed = {INVENTORY}
        for part, manifest in source.parts:
            inside = part.relative_to(source.folder)
            told = split.told_of(manifest["frames"])
            write_image_sets(folder / inside, split.frames(manifest["frames"]))
            write_json(
                folder / inside / "dataset.json",
                _manifest(manifest, told, asked, folder / inside),
            )
            changed |= {(inside / file).as_posix() for file in (*FILES, "dataset.json")}
        if source.manifest["kind"] == "datasets":
            own = _asked_in(source.manifest, asked)
            own["datasets_sha256"] = {
                name: sha256_of(folder / name / "dataset.json") for name in own["datasets"]
            }
            write_json(folder / "dataset.json", own)
            changed.add("dataset.json")
        with told_of(source.folder, folder):
            changed |= renew_cards(folder, sums, redraw)
        # Unchanged files keep their checksum, so that damaged ones stay detectable.
        kept = {name: digest for name, digest in sums.items() if name not in changed}
        write_inventory(folder, known=kept)
    return told


def _link(file: Path, to: Path) -> None:
    """Hard-link a file, or copy it if the file system has no hard links."""
    to.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(file, to)
    except OSError:
        shutil.copy2(file, to)


def _manifest(
    manifest: dict[str, Any], told: dict[str, Any], asked: SplitAsked, folder: Path
) -> dict[str, Any]:
    """Return a manifest as `record` would have written it with this split."""
    made = _asked_in(manifest, asked)
    counts = {part: one["frames"] for part, one in told["parts"].items()}
    before = {"frames": made["counts"]["frames"]}
    made["counts"] = {**before, **counts, **{
        key: value for key, value in made["counts"].items() if key not in (*before, *counts)
    }}  # fmt: skip
    if "layout" in made:
        made["layout"] = {**made["layout"], "ImageSets": LAYOUT["ImageSets"]}
    tables = {**made.get("tables_sha256", {}), **{name: sha256_of(folder / name) for name in FILES}}
    others = [one for one in made.get("warnings", []) if one.get("about") != "split"]
    last = {
        "split": told,
        "tables_sha256": dict(sorted(tables.items())),
        "warnings": [*others, *rows_of(warnings_of_split(told))],
    }
    frames = made.pop("frames")
    return {
        **{key: value for key, value in made.items() if key not in last},
        **last,
        "frames": frames,
    }


def _asked_in(manifest: dict[str, Any], asked: SplitAsked) -> dict[str, Any]:
    """Return a manifest with the requested split, for reproduction."""
    made_from = manifest.get("made_from")
    if not isinstance(made_from, dict) or not isinstance(made_from.get("record"), dict):
        return dict(manifest)
    record = {**made_from["record"], "split": asked.told()}
    return {**manifest, "made_from": {**made_from, "record": record}}
