"""Reproducing a dataset from its manifest and its inputs."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from urbantwin.artefact import check_folder, claimed, new_folder, passing_folder
from urbantwin.dataset.provenance import asked_of
from urbantwin.dataset.recording import record
from urbantwin.dataset.reproduction.compare import (
    Given,
    compared,
    given_files,
    is_node,
    other_versions,
)
from urbantwin.dataset.reproduction.inputs import Found, found_inputs, places_to_look
from urbantwin.dataset.reproduction.source_manifest import (
    SourceManifest,
    read_source_manifest,
    value_at,
)
from urbantwin.dataset.split import SplitAsked, shares_of
from urbantwin.download import no_keys
from urbantwin.errors import InputError
from urbantwin.lidar import place_rig
from urbantwin.lidar.background_file import rig_with_backgrounds
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.sight import standing_rig
from urbantwin.progress import Progress, between
from urbantwin.site import load_rig_spec, load_site
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.fingerprint import mesh_sha256, meshes_sha256, table_sha256
from urbantwin.twin import Twin, build_twin, load_twin

__all__ = ["Plan", "make_again", "plan_of"]

#: Shows a stage of a name while a block runs.
Stage = Callable[[str], AbstractContextManager[Progress]]
#: Draws the pictures of a dataset's folder.
Draw = Callable[[Path, Twin, Motion, Progress], None]


@dataclass(frozen=True)
class Plan:
    """What is known before a dataset is made again.

    Attributes:
        source: its manifest.
        given: its bytes.
        versions: what of the programs and the machine is other now: ``of``, ``then``, ``now``.
        inputs: every input, and where it lies.
        twin: a twin to take instead of building it.
        motion: a motion to take instead of simulating it.
    """

    source: SourceManifest
    given: Given
    versions: list[dict[str, str]]
    inputs: list[Found]
    twin: Path | None = None
    motion: Path | None = None

    @property
    def missing(self) -> list[Found]:
        """The inputs that cannot be used."""
        return [one for one in self.inputs if one.problem]

    def refuse_missing(self) -> None:
        """Refuse to go on without all inputs.

        Raises:
            InputError: one is missing, or has other content; the first is named.
        """
        if not self.missing:
            return
        one = self.missing[0]
        terms = ", ".join(
            part
            for part in (one.kind, f"SHA-256 {one.sha256}" * bool(one.sha256), one.licence,
                         one.attribution)
            if part
        )  # fmt: skip
        more = f"; {len(self.missing) - 1} more cannot be used" if len(self.missing) > 1 else ""
        raise InputError(
            f"the input {one.name} ({terms}) {one.problem}{more}",
            file=self.source.file,
            expected="it in a folder given by --inputs, around the dataset, or in the current one",
        )

    def reasons(self) -> list[str]:
        """Return what may make other bytes."""
        return [
            *(f"{one['of']} was {one['then']}, is {one['now']}" for one in self.versions),
            *(f"{one.name} is {one.remark}" for one in self.inputs if one.remark),
        ]


def plan_of(
    path: Path,
    *,
    inputs: Sequence[Path] = (),
    twin: Path | None = None,
    motion: Path | None = None,
) -> Plan:
    """Read a dataset's manifest, and find out what making it again would need.

    Args:
        path: a dataset's folder or its ``dataset.json``.
        inputs: folders to look for inputs in, first.
        twin: its twin, if that is not to be built again.
        motion: its motion, if that is not to be simulated again.

    Raises:
        InputError: it is not a dataset, or does not say what it was made from; a folder is
            none; the twin or the motion is another.
    """
    for folder in inputs:
        if not folder.is_dir():
            raise InputError("is not a folder", file=folder, expected="a folder with inputs")
    source = read_source_manifest(path / "dataset.json" if path.is_dir() else path)
    tracer_on(source.dataset.backend)  # Is it there?
    if twin is not None and mesh_sha256(load_twin(twin).mesh) != source.dataset.scene_sha256:
        raise InputError("has another scene", file=twin, expected="the twin of the dataset")
    if motion is not None:
        taken = Motion.load(motion)
        made = (table_sha256(taken.rows), meshes_sha256(taken.meshes))
        if made != (source.dataset.motion_sha256, source.dataset.meshes_sha256):
            raise InputError(
                "has other actors", file=motion, expected="the motion of the dataset, as it was"
            )
    found = found_inputs(source, places_to_look(source, inputs), twin_given=twin is not None)
    return Plan(source, given_files(source), other_versions(source), found, twin, motion)


def make_again(
    plan: Plan,
    *,
    stage: Stage,
    out: Path | None = None,
    workers: int | None = None,
    draw: Draw | None = None,
) -> dict[str, Any]:
    """Make a dataset again, and compare it.

    Args:
        plan: see `plan_of`.
        stage: shows the progress of a stage.
        out: where the twin, the motion and the dataset go, a folder each; when not given they are
            scratch beside the dataset, which goes when they have been compared.
        workers: number of processes; as many as there are processors when not given.
        draw: draws pictures into the dataset, if it had some.

    Returns:
        See `compare.compared`.

    Raises:
        InputError: an input is missing or changed, or ``out`` cannot be written.
        StageError: a tool failed, or the disk is full.
    """
    plan.refuse_missing()
    source = plan.source
    taken = [source.file if plan.given.alone else _whole(source), plan.twin, plan.motion]
    taken += [Path(one.path) for one in plan.inputs if one.path and Path(one.path).exists()]
    if out is not None:
        for kind in ("twin", "motion", "dataset"):
            check_folder(out / kind, kind=kind, inputs=taken)
    with _place(out, _whole(source)) as (place, scratch):
        if plan.twin is not None:
            twin = load_twin(plan.twin)
        else:
            written = _written(scratch / "site.yaml", _with_files(plan, "site"))
            with stage("twin") as progress, no_keys():
                twin = build_twin(load_site(written), place / "twin", progress, stand=standing_rig)
        if plan.motion is not None:
            motion = Motion.load(plan.motion)
        else:
            with stage("traffic") as progress:
                motion = run_traffic(
                    twin, place / "motion", changes=source.motion.asked, progress=progress
                )
        again = place / "dataset"
        with stage("record") as progress:
            _recorded(plan, twin, motion, again, scratch, workers, progress, draw)
        return compared(source, plan.given, again, plan.reasons())


def _recorded(
    plan: Plan,
    twin: Twin,
    motion: Motion,
    again: Path,
    scratch: Path,
    workers: int | None,
    progress: Progress,
    draw: Draw | None,
) -> None:
    source = plan.source
    file = _written(scratch / "rig.yaml", _with_files(plan, "rig", twin.folder))
    spec = load_rig_spec(file, twin.frame)
    rig = place_rig(spec, twin.mesh, file=file, anchor_height_m=twin.anchor_height_m)
    files = [one.path for one in plan.inputs if one.document == "background"]
    background = [
        str(path) if one.sensor is None else f"{one.sensor}={path}"
        for one, path in zip(source.record.background, files, strict=True)
    ]
    fuse = source.record.fuse
    pictures = plan.given.pictures and draw is not None

    def also(folder: Path) -> None:
        assert draw is not None
        draw(folder, twin, motion, between(progress, 0.98, 1.0))

    record(
        twin,
        motion,
        rig_with_backgrounds(rig, background, fused=fuse),
        again,
        workers=workers,
        seed=source.dataset.seeds["record"],
        start_s=source.record.span_s[0],
        stop_s=source.record.span_s[1],
        every=source.record.every,
        rig_file=file,
        backend=source.dataset.backend,
        storage=source.record.storage,
        split=_split(source),
        asked=asked_of(spec, file, twin, background=background, fuse=fuse),
        inputs=[] if plan.motion is None else [plan.motion],
        also=also if pictures else None,
        progress=progress,
    )


def _split(source: SourceManifest) -> SplitAsked | None:
    """Return what was asked of the split; ``None``, the usual, where a dataset does not say."""
    asked = source.record.split
    if asked is None:
        return None
    shares = shares_of(asked.shares, "made_from.record.split.shares")
    return SplitAsked(shares, asked.gap_s, asked.moved_m)


def _with_files(plan: Plan, document: str, twin: Path | None = None) -> Mapping[str, Any]:
    """Return the site or the rig, naming files where they lie here."""
    source = plan.source
    value = copy.deepcopy(source.twin.made_from.site if document == "site" else source.record.rig)
    for one in plan.inputs:
        if one.document == document and one.path is not None:
            _name(value, one.at, one.path)
    if twin is not None:
        for own in source.record.files:
            if own.of == "twin":
                path = (twin / own.name).absolute()
                if not path.is_file():
                    raise InputError("not found", file=path, expected="a sensor's file of the twin")
                _name(value, tuple(own.at), str(path))
    return value


def _name(document: Any, at: tuple[str | int, ...], path: str) -> None:  # noqa: ANN401
    """Put the path of a file where a document names it."""
    if at[-1] == "model":  # ``MODEL:FILE`` of a Hesai sensor
        before, colon, _ = str(value_at(document, at)).rpartition(":")
        path = before + colon + path
    value_at(document, at[:-1])[at[-1]] = path


def _written(file: Path, value: Mapping[str, Any]) -> Path:
    file.write_text(yaml.safe_dump(value, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return file


def _whole(source: SourceManifest) -> Path:
    """Return the folder of the whole, of which a sensor's dataset or a node's is a part."""
    folder = source.file.parent.resolve()
    if is_node(folder):
        return folder.parent
    is_inside = source.part == folder.name and (folder.parent / "dataset.json").is_file()
    return folder.parent if source.part and is_inside else folder


@contextmanager
def _place(out: Path | None, dataset: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the folder to make everything in, and one for temporary files."""
    if out is not None:
        with new_folder(out), passing_folder("urbantwin-reproduce") as scratch:
            yield out, scratch
    elif os.access(dataset.parent, os.W_OK):
        with claimed(dataset.with_name(f"{dataset.name}-again")) as own:
            yield own.folder, own.folder
    else:
        with passing_folder("urbantwin-reproduce") as scratch:
            yield scratch, scratch
