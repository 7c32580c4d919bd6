"""Comparing a reproduced dataset with the original: whether bytes differ, where and why."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact import INVENTORY, damages, sha256_of
from urbantwin.artefact.inventory import read_inventory
from urbantwin.dataset.card.page import CARD
from urbantwin.dataset.layout import FOLDERS
from urbantwin.dataset.manifest import versions_here
from urbantwin.dataset.reproduction.source_manifest import SourceManifest

__all__ = ["Given", "compared", "given_files", "is_node", "other_versions"]

PICTURES = "pictures"
#: Stages in their order, and the fields of a manifest that depend on them.
_STAGES = (
    ("inputs", ("inputs",)),
    ("scene", ("scene_sha256",)),
    ("surface", ("surface_sha256",)),
    ("motion", ("motion_sha256",)),
    ("meshes", ("meshes_sha256",)),
    ("rig", ("rig", "frame", "dataset_SE3_site")),
)
#: So many names of files are listed.
MOST_NAMES = 20


@dataclass(frozen=True)
class Given:
    """What is known of the bytes of a dataset.

    Attributes:
        sums: SHA-256 by name of file; of a manifest alone, by name of frame.
        damaged: what is wrong with a file against its inventory, by name.
        alone: there is only the manifest.
        pictures: the dataset has pictures.
    """

    sums: dict[str, str]
    damaged: dict[str, str]
    alone: bool
    pictures: bool


def given_files(source: SourceManifest) -> Given:
    """Return what is known of a dataset's bytes: by its files, its inventory or its manifest.

    Raises:
        InputError: its inventory is damaged.
    """
    folder = source.file.parent
    whole = folder.parent if _is_part(source) else folder
    inside = f"{folder.name}/" if whole != folder else ""
    names = tuple(source.dataset.datasets_sha256) or FOLDERS
    recorded = any((folder / name).is_dir() for name in names)
    if (whole / INVENTORY).is_file():
        named = read_inventory(whole)
        sums = {k.removeprefix(inside): v for k, v in named.items() if k.startswith(inside)}
        wrong = {}
        if recorded:
            below = inside.removesuffix("/")
            wrong = {
                one.name.removeprefix(inside): one.problem for one in damages(whole, below=below)[1]
            }
        elif sums.get("dataset.json") != sha256_of(source.file):
            wrong = {"dataset.json": "damaged"}
        wrong = {name: problem for name, problem in wrong.items() if problem != "foreign"}
        return Given(sums | wrong, wrong, alone=False, pictures=_has_pictures(sums))
    if recorded:
        files = [path for path in folder.rglob("*") if path.is_file()]
        sums = {path.relative_to(folder).as_posix(): sha256_of(path) for path in sorted(files)}
        return Given(sums, {}, alone=False, pictures=_has_pictures(sums))
    return Given(_told_sums(source.document, source.file), {}, alone=True, pictures=False)


def other_versions(source: SourceManifest) -> list[dict[str, str]]:
    """Return what of the programs and the machine is other than when a dataset was made."""
    now = versions_here(source.dataset.backend)
    then = source.dataset
    pairs = [
        ("urbantwin", then.urbantwin, __version__),
        *(
            (f"urbantwin of the {name}", version, __version__)
            for name, version in (
                ("twin", source.twin.version),
                ("motion", source.motion.urbantwin),
            )
            if version != then.urbantwin
        ),
        ("python", then.python, now["python"]),
        ("platform", then.platform, now["platform"]),
        *(
            (name, then.dependencies.get(name, "none"), now["dependencies"].get(name, "none"))
            for name in sorted({*then.dependencies, *now["dependencies"]})
        ),
    ]
    return [{"of": name, "then": old[:60], "now": new} for name, old, new in pairs if old != new]


def compared(
    source: SourceManifest, given: Given, again: Path, reasons: list[str]
) -> dict[str, Any]:
    """Compare a dataset with the same made again.

    Args:
        source: its manifest.
        given: what is known of its bytes.
        again: the folder of the one that was made.
        reasons: what is known to be other than it was.

    Returns:
        ``same``, ``files``, and where they differ ``differing``, ``first`` of them, ``by_folder``,
        ``earliest`` (the first stage that differs) and ``why``; ``pictures``, apart.
    """
    inside = f"{source.part}/" if source.part else ""
    now = {
        name.removeprefix(inside): digest
        for name, digest in read_inventory(again).items()
        if name.startswith(inside) and _is_data(name)
    }
    mine = again / source.part if source.part else again
    files = sum(not _is_picture(name) for name in now)
    manifest = json.loads((mine / "dataset.json").read_text(encoding="utf-8"))
    if given.alone:
        now = _told_sums(manifest, mine / "dataset.json")
    then = {name: digest for name, digest in given.sums.items() if _is_data(name)}
    if is_node(source.file.parent):  # How it is split follows from what all nodes saw.
        then, now = ({k: v for k, v in sums.items() if not _of_split(k)} for sums in (then, now))
    names = sorted(then.keys() | now.keys())
    other = [name for name in names if then.get(name) != now.get(name)]
    data = [name for name in other if not _is_picture(name)]
    report: dict[str, Any] = {"same": not data, "files": files}
    drawn = sum(map(_is_picture, names))
    if drawn:
        report["pictures"] = {"files": drawn, "differing": len(other) - len(data)}
    if not data:
        return report
    then_now = source.document, manifest
    stages = [
        stage
        for stage, keys in _STAGES
        if any(then_now[0].get(key) != then_now[1].get(key) for key in keys)
    ]
    first = [*stages, "manifest" if data == ["dataset.json"] else "frames"][0]
    folders = Counter(name.rpartition("/")[0] or name for name in data)
    return {
        **report,
        "differing": len(data),
        "first": data[:MOST_NAMES],
        "by_folder": dict(sorted(folders.items())),
        "earliest": first,
        "why": _why(source, given, manifest, reasons, data),
    }


def _why(
    source: SourceManifest,
    given: Given,
    manifest: Mapping[str, Any],
    reasons: list[str],
    data: list[str],
) -> list[str]:
    """Return what may have made the files in ``data`` other than they were."""
    hurt = [name for name in data if name in given.damaged]
    if hurt == data == ["dataset.json"] and reasons:
        return [*reasons, "every frame and table is the same"]
    why = []
    if hurt:
        more = f", and {len(hurt) - 1} more" if len(hurt) > 1 else ""
        why = [f"{hurt[0]} is {given.damaged[hurt[0]]}{more}: not what was written ({INVENTORY})"]
        if hurt == data:
            return [*why, "what was made again is what was written"]
    files = [
        {tuple(one["at"]): one for one in document["made_from"]["twin"]["made_from"]["files"]}
        for document in (source.document, manifest)
    ]
    why += [
        *reasons,
        *(
            f"{old['name']} or a file beside it was read with other content"
            for at, old in files[0].items()
            if files[1].get(at, old) != old
        ),
    ]
    return why or [
        "the same versions and inputs: the processor, a library that is not listed, or a defect"
    ]


def _told_sums(document: Mapping[str, Any], file: Path) -> dict[str, str]:
    """Return what a manifest says of its files, and its own SHA-256."""
    parts = {
        f"{name}/dataset.json": one for name, one in document.get("datasets_sha256", {}).items()
    }
    frames = {f"frames/{one['name']}": one["sha256"] for one in document.get("frames", [])}
    tables = document.get("tables_sha256", {})
    return {**parts, **frames, **tables, "dataset.json": sha256_of(file)}


def is_node(folder: Path) -> bool:
    """Return whether a dataset is that of a node, in the folder of its fleet."""
    return (folder.resolve().parent / "fleet.json").is_file()


def _is_part(source: SourceManifest) -> bool:
    """Return whether a dataset lies in the folder with one for each sensor, or in its fleet."""
    folder = source.file.parent
    if is_node(folder):
        return (folder.parent / INVENTORY).is_file() and not (folder / INVENTORY).is_file()
    if not source.part or folder.name != source.part or (folder / INVENTORY).is_file():
        return False
    return (folder.parent / INVENTORY).is_file() and (folder.parent / "dataset.json").is_file()


def _has_pictures(sums: Mapping[str, str]) -> bool:
    return any(map(_is_picture, sums))


def _is_data(name: str) -> bool:
    """Return whether a file is neither made of the others alone nor a card."""
    return name.rpartition("/")[2] not in (INVENTORY, "blocks.parquet", CARD)


def _of_split(name: str) -> bool:
    return name == "dataset.json" or name.startswith("ImageSets/")


def _is_picture(name: str) -> bool:
    return PICTURES in name.split("/")[:-1]
