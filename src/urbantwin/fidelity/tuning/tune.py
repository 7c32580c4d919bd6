"""Tuning: fits uncertain parameters of a rig and its traffic to unlabelled real frames."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from urbantwin.artefact import check_folder, replaced_folder, sha256_of, write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.tuning.fit import RigFit, RigTerms, fit_rig
from urbantwin.fidelity.tuning.fit_actors import fit_actors
from urbantwin.fidelity.tuning.frames import Looks, Split, looks_of, open_unlabelled, split_in_time
from urbantwin.fidelity.tuning.group_fit import Searching
from urbantwin.fidelity.tuning.held_out import judge
from urbantwin.fidelity.tuning.knobs import GROUPS
from urbantwin.fidelity.tuning.result import fit_as_json, split_as_json
from urbantwin.fidelity.tuning.study import Journal
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, write_tuned_rig
from urbantwin.lidar import Rig
from urbantwin.progress import Progress, untold
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["Tuning", "tune"]


@dataclass(frozen=True)
class Tuning:
    """Options of tuning.

    Attributes:
        fit: groups of ``knobs.GROUPS`` to fit.
        held_out: share of the frames, the last ones, that are not used for fitting.
        trials: number of trials of each group.
        seed: seed of the samplers and of the sampled points.
        workers: threads that compute trials; they do not change results.
        points_in: frame of the real points; the rig's ``frame:`` if not given.
        layout: layout of the real frames, if their files do not show it.
        columns: values per row of ``.bin`` files, if neither 4 nor 3.
        report: measure the held-out frames as ``compare`` does, and draw them.
    """

    fit: tuple[str, ...] = field(default=GROUPS)
    held_out: float = 0.3
    trials: int = 300
    seed: int = 0
    workers: int = 1
    points_in: PointsIn | None = None
    layout: str | None = None
    columns: int | None = None
    report: bool = True


def tune(
    real: Path,
    twin: Twin,
    rig: Rig,
    rig_file: Path,
    out: Path,
    *,
    motion: Motion | None = None,
    tuning: Tuning | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Fit a rig and its traffic to the first part of a recording, and evaluate them on the last.

    ``rig.yaml`` and ``tuning.json`` are written when the fit is done. Only then are the held-out
    frames opened, and ``held_out.json`` and ``report.html`` written. Labels are never read. An
    interrupted run leaves its journal in a temporary folder beside ``out``, from which the same
    command resumes.

    Args:
        real: a recording of the rig, in any layout of ``readers``.
        twin: twin of the recorded place.
        rig: the rig as written in its file.
        rig_file: the rig's file.
        out: output folder; an older tuning there is replaced.
        motion: traffic of the twin, for its actors.
        tuning: options.
        progress: called with the fraction done (0..1) and the current step.

    Returns:
        The contents of ``tuning.json`` and ``held_out.json``.

    Raises:
        InputError: fewer than two frames, no readable training frame, a rig mounted on an actor, or
            ``out`` holds other files.
    """
    asked = tuning or Tuning()
    say = progress or untold
    if rig.ride is not None:
        raise InputError(
            "its rig is mounted on a vehicle", file=rig_file, place="ride", expected="a static rig"
        )
    if asked.trials < 1:
        raise InputError(f"{asked.trials} trials", place="trials", expected="1 or more")
    points_in: PointsIn = asked.points_in or rig.frame
    inputs = [real, twin.folder, rig_file]
    check_folder(out, kind="tuning", inputs=inputs)
    recording = open_unlabelled(real, layout=asked.layout, columns=asked.columns)
    try:
        split = split_in_time(len(recording), asked.held_out)
    except InputError as error:
        raise InputError(
            error.problem,
            file=None if error.place else real,
            place=error.place,
            expected=error.expected,
        ) from None
    say(0.0, "reading the frames that are fitted to")
    count = len(rig.sensors)
    train, scale = looks_of(recording, split.training, count)
    proof = None
    if split.validation:
        proof, _ = looks_of(recording, split.validation, count, scale=scale)
    done = list(asked.fit)

    def tell(study: str, share: float) -> None:
        place = next((k for k, one in enumerate(GROUPS) if study.startswith(one)), 0)
        say(0.1 + 0.7 * (place + share) / len(GROUPS), f"{study}: {share:.0%} of the trials")

    recipe = _recipe(twin, rig_file, motion, asked, points_in, split, train, proof)
    with (
        replaced_folder(out, kind="tuning", inputs=inputs, key=recipe[:16]) as folder,
        _journal(folder, recipe) as journal,
    ):
        searching = Searching(asked.trials, asked.seed, journal, asked.workers, tell)
        parts = [
            None if looks is None else RigTerms(looks, twin, rig, points_in, asked.seed)
            for looks in (train, proof)
        ]
        assert parts[0] is not None
        fit = fit_rig(parts[0], parts[1], done, searching, lambda doing: say(0.1, doing))
        changed = None
        if "actors" in done:
            say(0.7, "recording the twin's actors")
            changed = fit_actors(parts[0], parts[1], motion, fit, searching)
        written = _written(real, asked, points_in, split, fit, train, proof)
        write_tuned_rig(rig_file, folder / "rig.yaml", rig, fit.values)
        if changed is not None:
            text = yaml.safe_dump(changed, sort_keys=False)
            (folder / "traffic.yaml").write_text(text, encoding="utf-8")
        write_json(folder / "tuning.json", written)
        # Held-out frames are not opened before this point.
        say(0.8, "judging by the frames held out")
        judged = judge(
            recording,
            split,
            twin,
            rig,
            fit,
            points_in,
            folder,
            motion=motion,
            scale=scale,
            seed=asked.seed,
            training=train if asked.report else None,
            tell=lambda share, doing: say(0.8 + 0.2 * share, doing),
        )
    say(1.0, "done")
    return {**written, "held_out": judged}


def _journal(folder: Path, recipe: str) -> Journal:
    """Return the journal in a folder, and delete all other remains of an interrupted run."""
    path = folder / "journal"
    for left in folder.iterdir():
        if left != path:
            left.unlink()
    return Journal(path, recipe)


def _written(
    real: Path,
    asked: Tuning,
    points_in: PointsIn,
    split: Split,
    fit: RigFit,
    train: Looks,
    proof: Looks | None,
) -> dict[str, Any]:
    problems = [*train.problems, *(proof.problems if proof else ())]
    notes = list(fit.notes)
    if proof is None:
        notes.append("Too few frames to prove a fit on others: every fit is kept.")
    return {
        "kind": "tuning",
        "version": 1,
        "real": real.resolve().name,
        "points_in": points_in,
        "fit": list(asked.fit),
        "trials": asked.trials,
        "seed": asked.seed,
        "split": split_as_json(split),
        **fit_as_json(fit),
        "notes": notes,
        "problems": problems,
    }


def _recipe(
    twin: Twin,
    rig_file: Path,
    motion: Motion | None,
    asked: Tuning,
    points_in: PointsIn,
    split: Split,
    train: Looks,
    proof: Looks | None,
) -> str:
    """Return a hash of everything that the fit depends on."""
    digest = hashlib.sha256()
    for looks in (train, proof):
        if looks is not None:
            digest.update(looks.points.tobytes())
            digest.update(b"" if looks.intensity is None else looks.intensity.tobytes())
            digest.update(looks.sensor.tobytes() + looks.frame.tobytes())
    said = {
        "twin": twin.sha256,
        "rig": sha256_of(rig_file),
        "motion": None if motion is None else motion.sha256(),
        "fit": asked.fit,
        "trials": asked.trials,
        "seed": asked.seed,
        "points_in": points_in,
        "split": split_as_json(split),
        "frames": digest.hexdigest(),
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()
