"""Course of a fusion study: detections of nodes alone, then every setting at every moment.

Moments are independent, so any number of processes can work on them. Results stay in a folder, from
which an interrupted study continues.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from urbantwin.errors import InputError, StageError
from urbantwin.geometry import Pose
from urbantwin.learn.model import Model, read_model
from urbantwin.processes import worker_pool
from urbantwin.progress import Progress, between, untold
from urbantwin.studies.fusion.boxes import Boxes
from urbantwin.studies.fusion.nodes import Node, Nodes, open_nodes
from urbantwin.studies.fusion.own_view import detected_by, with_motion
from urbantwin.studies.fusion.setting import Setting
from urbantwin.studies.fusion.trial import Outcome, Trial

__all__ = ["Plan", "chosen_moments", "outcomes_of", "places_of", "seconds_needed"]

#: Time after the first frame before detections are evaluated, since messages may be late, seconds.
_WARM_UP_S = 1.0
#: Lowest score of a box.
_LEAST = 0.05


@dataclass(frozen=True)
class Plan:
    """Plan of a study.

    Attributes:
        model: folder of the detector.
        paths: paths of the nodes, see `open_nodes`.
        ego: name of the receiver.
        only: names of the participating nodes.
        settings: settings to compare.
        moments: moments to evaluate.
        mtu: largest size of a packet, bytes.
        seed: random seed.
    """

    model: Path
    paths: tuple[Path, ...]
    ego: str | None
    only: tuple[str, ...] | None
    settings: tuple[Setting, ...]
    moments: tuple[int, ...]
    mtu: int
    seed: int


def chosen_moments(nodes: Nodes, frames: int) -> tuple[int, ...]:
    """Return evenly spaced moments with a frame of the receiver, at most ``frames``.

    Args:
        nodes: the nodes; the receiver first.
        frames: largest number of moments.

    Raises:
        InputError: the receiver has no such frame.
    """
    begin = min(look.time_s for node in nodes.nodes for look in node.looks.values())
    there = [
        moment
        for moment, look in sorted(nodes.ego.looks.items())
        if look.time_s >= begin + _WARM_UP_S - 1e-9
    ]
    if not there:
        raise InputError(
            f"has no frame {_WARM_UP_S:g} s after the first one or later",
            file=nodes.ego.folder,
            expected="a longer recording: messages may be as late as that",
        )
    which = np.unique(np.linspace(0, len(there) - 1, min(frames, len(there))).round().astype(int))
    return tuple(there[one] for one in which)


def outcomes_of(
    plan: Plan, folder: Path, workers: int, tell: Progress = untold
) -> list[list[Outcome]]:
    """Return the result of every setting (outer) at every moment (inner).

    Args:
        plan: plan of the study.
        folder: folder of stored results.
        workers: number of processes.
        tell: called with the fraction done and a description.

    Raises:
        InputError: a file is damaged.
        StageError: a worker was killed.
    """
    desk = _Desk(plan, folder)
    folder.mkdir(parents=True, exist_ok=True)
    looks = [(node.number, moment) for node in desk.nodes.nodes for moment in sorted(node.looks)]
    with _workers(plan, folder, workers) as submit:
        alone = [one for one in looks if not desk.own_file(*one).is_file()]
        for done, _ in enumerate(submit(_see, alone)):
            tell(0.2 * (done + 1) / len(alone), f"what nodes see alone, {done + 1} of {len(alone)}")
        ahead = [one for one in plan.moments if not desk.trial_file(one).is_file()]
        rest = between(tell, 0.2, 1.0)
        for done, _ in enumerate(submit(_try, [(one,) for one in ahead])):
            rest((done + 1) / len(ahead), f"moment {done + 1} of {len(ahead)}")
    found = [_read(desk.trial_file(moment)) for moment in plan.moments]
    return [list(one) for one in zip(*found, strict=True)]


def seconds_needed(plan: Plan, workers: int) -> float:
    """Return the estimated time of a study on this machine, seconds, by timing a few steps.

    Args:
        plan: plan of the study.
        workers: number of processes.
    """
    desk = _Desk(plan, Path())
    ego = desk.nodes.ego
    frame = ego.frame(plan.moments[0])
    times = []
    with _one_thread():
        for _ in range(3):  # the first call compiles code
            began = time.monotonic()
            detected_by(desk.model, frame, _LEAST)
            times.append(time.monotonic() - began)
    each = min(times)
    works = {one.work for one in plan.settings if one.how.name in ("early", "middle")}
    looks = sum(len(node.looks) for node in desk.nodes.nodes)
    # A moment also encodes one frame of every node, and two late ones.
    moment = 1.15 * len(works) + 3 * len(desk.nodes.nodes)
    return each * (looks + moment * len(plan.moments)) / workers


class _Desk:
    """Working data of a process."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, folder

    @cached_property
    def nodes(self) -> Nodes:
        return open_nodes(self.plan.paths, self.plan.ego, self.plan.only)

    @cached_property
    def model(self) -> Model:
        return read_model(self.plan.model)

    @cached_property
    def trial(self) -> Trial:
        """Trials of settings; the detections of every node alone must have been written."""
        seen = {node.number: self._going(node) for node in self.nodes.nodes}
        plan = self.plan
        return Trial(self.model, self.nodes, seen, mtu=plan.mtu, seed=plan.seed, least=_LEAST)

    def own_file(self, node: int, moment: int) -> Path:
        return self.folder / f"own-{node:03}-{moment:06}.npz"

    def trial_file(self, moment: int) -> Path:
        return self.folder / f"trial-{moment:06}.npz"

    def see(self, number: int, moment: int) -> None:
        node = next(one for one in self.nodes.nodes if one.number == number)
        frame = node.frame(moment)
        boxes = detected_by(self.model, frame, _LEAST)
        _write(self.own_file(number, moment), place=frame.sensor_places.mean(axis=0), **vars(boxes))

    def _going(self, node: Node) -> dict[int, Boxes]:
        """Return a node's detections with their motion, by moment."""
        seen, local = {}, {}
        for moment, look in node.looks.items():
            with np.load(self.own_file(node.number, moment)) as arrays:
                seen[moment] = Boxes(*(arrays[name] for name in Boxes.__dataclass_fields__))
                local[moment] = look.reported @ Pose(np.eye(3), arrays["place"])
        return with_motion(node, seen, local)

    def attempt(self, moment: int) -> None:
        found = self.trial.outcomes(moment, self.plan.settings)
        _write(
            self.trial_file(moment),
            count=np.array([len(one.box) for one in found]),
            box=np.concatenate([one.box for one in found]),
            kind=np.concatenate([one.kind for one in found]),
            score=np.concatenate([one.score for one in found]),
            cost=np.array([(one.bits, one.bits_s, one.packets, one.age_s) for one in found]),
        )


def _write(path: Path, **arrays: NDArray[Any]) -> None:
    passing = path.with_name(f".{path.name}")
    with passing.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    passing.replace(path)


def _read(path: Path) -> list[Outcome]:
    """Return the results of a moment from a file."""
    with np.load(path) as arrays:
        ends = np.cumsum(arrays["count"])[:-1]
        parts = [np.split(arrays[name], ends) for name in ("box", "kind", "score")]
        rows = zip(*parts, arrays["cost"].tolist(), strict=True)
        return [Outcome(*found, *cost) for *found, cost in rows]


_Work = Callable[..., None]


@contextmanager
def _workers(
    plan: Plan, folder: Path, workers: int
) -> Iterator[Callable[[_Work, Sequence[tuple[int, ...]]], Iterator[None]]]:
    """Yield a function that runs tasks and yields after each, in this process or in several.

    Every process uses one thread, so the bytes do not depend on their number.
    """
    if workers == 1:
        with _one_thread():
            _begin(plan, folder)

            def here(work: _Work, tasks: Sequence[tuple[int, ...]]) -> Iterator[None]:
                for one in tasks:
                    work(*one)
                    yield

            yield here
        return
    try:
        with worker_pool(workers, _begin, plan, folder) as pool:

            def there(work: _Work, tasks: Sequence[tuple[int, ...]]) -> Iterator[None]:
                for one in as_completed([pool.submit(work, *task) for task in tasks]):
                    one.result()
                    yield

            yield there
    except BrokenProcessPool:
        raise StageError(
            "a worker was killed (out of memory?); what is finished is kept: give the same command "
            "again, with fewer workers"
        ) from None


@contextmanager
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


_desk: _Desk | None = None


def _begin(plan: Plan, folder: Path) -> None:
    global _desk  # noqa: PLW0603 - a worker's only state: the model and what nodes see
    torch.set_num_threads(1)
    _desk = _Desk(plan, folder)


def _see(node: int, moment: int) -> None:
    assert _desk is not None
    _desk.see(node, moment)


def _try(moment: int) -> None:
    assert _desk is not None
    _desk.attempt(moment)


def places_of(nodes: Nodes, moments: Sequence[int]) -> NDArray[np.float64]:
    """Return the receiver's true positions (M, 2) at moments: the mean of its sensors, metres.

    Args:
        nodes: the nodes; the receiver first.
        moments: moments of its frames.
    """
    ego = nodes.ego
    found = [
        ego.looks[one].true.apply(ego.frame(one).sensor_places).mean(axis=0) for one in moments
    ]
    return np.array(found).reshape(-1, 3)[:, :2]
