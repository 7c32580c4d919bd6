"""Studies of cooperative perception: benefit and bandwidth of sharing data between nodes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval

from urbantwin.artefact import INVENTORY, check_folder, read_json, replaced_folder, sha256_of
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.studies.fusion import Nodes


__all__ = ["FusionStudy", "fuse"]

_KIND = "fusion"


class FusionStudy(Artefact):
    """Result of a fusion study: a table of settings, pictures and a page.

    Attributes:
        folder: the study's folder, also for a plan; ``fusion.html`` in it is the report page.
        manifest: content of ``fusion.json``; empty for a plan.
        seconds: estimated run time, for a plan.
    """

    def __init__(self, folder: AnyPath, seconds: float | None = None) -> None:
        self.folder, self.seconds = Path(folder), seconds
        self.manifest: dict[str, Any] = (
            {} if seconds is not None else read_json(self.folder / f"{_KIND}.json", kind=_KIND)
        )

    @classmethod
    def open(cls, folder: AnyPath) -> FusionStudy:
        """Return the study in a folder that `fuse` wrote.

        Raises:
            InputError: the folder holds no study.
        """
        return cls(folder)

    def __repr__(self) -> str:
        """Return the headline and the folder."""
        return f"{self.manifest.get('in_short', 'a plan')} ({self.folder})"

    @property
    def settings(self) -> pa.Table:
        """``settings.parquet``: a row per setting."""
        from urbantwin.artefact.tables import read_parquet

        return read_parquet(self.folder / "settings.parquet", "settings of a fusion study")

    @property
    def over_time(self) -> pa.Table | None:
        """``over_time.parquet``: detection while a node fails; None if not studied."""
        from urbantwin.artefact.tables import read_parquet

        file = self.folder / "over_time.parquet"
        return read_parquet(file, "a fusion study over time") if file.is_file() else None

    def summary(self) -> Summary:
        """Return the headline, doubts and counts."""
        if self.seconds is not None:
            return Summary(path=str(self.folder), minutes=round(self.seconds / 60, 1))
        told = self.manifest
        return Summary(
            path=str(self.folder),
            page=str(self.folder / f"{_KIND}.html"),
            in_short=told["in_short"],
            doubts=told["doubts"],
            nodes=[one["name"] for one in told["nodes"]],
            frames=told["frames"],
            objects=told["objects"],
            distinct_objects=told["distinct"],
            settings=told["settings"],
        )


@command
def fuse(
    model: AnyPath,
    data: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    ego: Annotated[str | None, "NAME"] = None,
    nodes: Annotated[Sequence[str] | None, "NAME"] = None,
    studies: Annotated[Sequence[str] | None, "NAME"] = None,
    frames: Annotated[int, Interval(ge=2, le=100000)] = 40,
    within: Annotated[float | None, Interval(ge=1, le=500)] = None,
    mtu: Annotated[int, Interval(ge=256, le=65593)] = 1400,
    seed: Annotated[int, Ge(0)] = 0,
    workers: Annotated[int, Ge(1)] = 1,
    plan: bool = False,
    progress: ShowProgress = True,
) -> FusionStudy:
    """Compare what nodes gain by sharing what they see.

    Nodes share clouds, features or boxes. After an interruption, the same call continues.

    Args:
        model: folder that ``model train`` wrote.
        data: fleet, folder of datasets (``record --separate``), or a dataset for each node.
        out: folder to write; ``fusion`` beside the first of the data if not given.
        ego: name of the node that receives; the first if not given.
        nodes: name of a participating node, in the order of adding; all if not given.
        studies: study: ``bitrate``, ``latency``, ``clock``, ``pose``, ``loss``, ``nodes`` or
            ``failure``; all if not given.
        frames: number of the receiver's frames, evenly spaced, to evaluate on.
        within: largest distance from the receiver of an object that counts, metres; the model's
            range if not given.
        mtu: packet size, bytes, without the headers of UDP and IP.
        seed: random seed of packet losses and pose errors.
        workers: number of processes; every number gives the same bytes.
        plan: only print the estimated time.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: torch is not installed, or the model or the nodes cannot be used.

    Example:
        $ urbantwin model fuse model/ fleet/ -o fusion/ --plan
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch("cpu")
    import numpy as np

    from urbantwin import __version__
    from urbantwin.dataset.manifest import recipe_key
    from urbantwin.learn import read_model
    from urbantwin.progress import between
    from urbantwin.studies.fusion import (
        STUDIES,
        Judge,
        Plan,
        chosen_moments,
        open_nodes,
        outcomes_of,
        places_of,
        rows_of,
        rows_of_failure,
        seconds_needed,
        settings_of,
        write_report,
    )

    source = Path(model)
    given = [Path(one) for one in ([data] if isinstance(data, str | os.PathLike) else data)]
    if not given:
        raise InputError("no data is given", expected="a fleet, or two datasets or more")
    target = beside(given[0], _KIND) if out is None else Path(out)
    inputs = [source, *given]
    check_folder(target, kind=_KIND, inputs=inputs)
    detector = read_model(source)
    if not detector.design.classes:
        raise InputError(
            "has no output of boxes", file=source, expected="a model of `urbantwin model train`"
        )
    reach = detector.design.range_m
    if within is not None and not 0 < within <= reach:
        raise InputError(
            f"{within:g} m is beyond the model's range", place="--within",
            expected=f"at most {reach:g} m, or a model trained with a greater --range",
        )  # fmt: skip
    within = reach if within is None else within
    told = open_nodes(given, ego, nodes)
    moments = chosen_moments(told, frames)
    time_s = np.array([told.ego.looks[one].time_s for one in moments])
    settings = settings_of(
        STUDIES if studies is None else studies,
        len(told.nodes),
        fails_from_s=float(time_s[len(time_s) // 2]),
        last=told.nodes[-1].number,
    )
    todo = Plan(
        model=source,
        paths=tuple(given),
        ego=ego,
        only=None if nodes is None else tuple(nodes),
        settings=tuple(settings),
        moments=moments,
        mtu=mtu,
        seed=seed,
    )
    if plan:
        return FusionStudy(target, seconds_needed(todo, workers))
    judge = Judge(
        [told.names[one] for one in moments],
        time_s,
        [told.labelled(one) for one in moments],
        places_of(told, moments),
        within,
        detector.design.classes,
    )
    asked = {
        "urbantwin": __version__,
        "model": sha256_of(source / "model.safetensors"),
        "nodes": [[node.name, *_digests(node.folder)] for node in told.nodes],
        "settings": [str(one) for one in settings],
        "moments": list(moments),
        "mtu": mtu,
        "seed": seed,
    }
    with (
        shown_stage("fuse", progress) as tell,
        replaced_folder(target, kind=_KIND, inputs=inputs, key=recipe_key(asked)) as scratch,
    ):
        work = scratch / "work"
        outcomes = outcomes_of(todo, work, workers, between(tell, 0.0, 0.9))
        tell(0.9, "judging")
        rows = rows_of(settings, outcomes, judge)
        over_time = rows_of_failure(settings, outcomes, judge, time_s)
        shutil.rmtree(work)
        write_report(
            scratch,
            {
                "model": source.name,
                "model_sha256": asked["model"],
                "trained_on": ", ".join(
                    str(one.get("name")) for one in detector.trained.get("datasets", [])
                )
                or "what nobody told",
                "nodes": [
                    {"name": one.name, "frames": len(one.looks), "rides": one.track is not None}
                    for one in told.nodes
                ],
                "frames": len(moments),
                "frames_together": judge.block,
                "within_m": within,
                "mtu": mtu,
                "seed": seed,
                "objects": judge.objects,
                "distinct": judge.distinct,
                "settings": len(settings),
                "doubts": [*_learned_from(detector.trained, told), *filter(None, [judge.doubt])],
            },
            rows,
            over_time,
        )
    made = FusionStudy(target)
    for doubt in made.manifest["doubts"]:
        tell_line(f"warning: {doubt}", progress)
    return made


def _learned_from(trained: Mapping[str, Any], nodes: Nodes) -> list[str]:
    """Return a doubt if the model was trained on frames of a node."""
    from urbantwin.artefact import digest_of

    known = {one.get("sha256") for one in trained.get("datasets", [])}
    seen = [one.name for one in nodes.nodes if known and digest_of(one.folder) in known]
    if not seen:
        return []
    return [
        f"The model has learned from frames of {', '.join(seen)}: frames of another drive tell how "
        "good it is."
    ]


def _digests(folder: Path) -> list[str]:
    """Return hashes that identify the files of a node's dataset."""
    files = (folder / INVENTORY, folder / "dataset.json")
    return [sha256_of(one) for one in files if one.is_file()]
