"""Casts of views, made once each by processes, and kept on disk until the search is over."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from urbantwin.errors import StageError
from urbantwin.lidar.rig import MountedSensor
from urbantwin.processes import worker_pool
from urbantwin.studies.placement.sighting import (
    Caster,
    Recipe,
    Sighting,
    read_sighting,
    write_sighting,
)
from urbantwin.studies.placement.view import Layout, Views

__all__ = ["Casts", "casts_in"]


@dataclass(eq=False)
class Casts:
    """What views see, cast when it is first asked for.

    Attributes:
        views: every view.
        recipe: what they share.
        folder: where they are kept.
        here: casts in this process.
        pool: processes that cast; ``None``: this one does.
        made: how many were cast by this run.
    """

    views: Views
    recipe: Recipe
    folder: Path
    here: Caster
    pool: ProcessPoolExecutor | None = None
    made: int = 0
    _known: dict[int, Sighting] = field(default_factory=dict)

    def of(self, layout: Layout) -> list[Sighting]:
        """Return what each view of a layout sees."""
        self.ensure(layout)
        return [self._known[number] for number in layout]

    def ensure(
        self, numbers: Sequence[int], tell: Callable[[int, int], None] | None = None
    ) -> None:
        """Cast the views that are not known yet.

        Args:
            numbers: of the views.
            tell: called with how many are cast, and how many have to be.

        Raises:
            StageError: a worker was killed.
        """
        missing = []
        for number in dict.fromkeys(numbers):
            if number in self._known:
                continue
            kept = read_sighting(self.path(number))
            if kept is None:
                missing.append(number)
            else:
                self._known[number] = kept
        for count, (number, sighting) in enumerate(self._cast(missing), 1):
            self._known[number] = sighting
            self.made += 1
            if tell is not None:
                tell(count, len(missing))

    def path(self, number: int) -> Path:
        """Return the file of a view."""
        return self.folder / f"view-{number:06d}.npz"

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, Sighting]]:
        tasks = [
            (
                self.views.hung(number, self.recipe.models),
                self.views.every[number].model,
                self.path(number),
            )
            for number in numbers
        ]
        if self.pool is None:
            for number, (mounted, model, path) in zip(numbers, tasks, strict=True):
                sighting = self.here.cast(mounted, model)
                write_sighting(path, sighting)
                yield number, sighting
            return
        try:
            waiting = {
                self.pool.submit(_cast, *task): number
                for number, task in zip(numbers, tasks, strict=True)
            }
            for one in as_completed(waiting):
                one.result()
                number = waiting[one]
                made = read_sighting(self.path(number))
                assert made is not None
                yield number, made
        except BrokenProcessPool:
            raise StageError(
                "a worker was killed (out of memory?); what was cast is kept: "
                "give the same command again, with fewer workers"
            ) from None


@contextmanager
def casts_in(folder: Path, views: Views, recipe: Recipe, workers: int) -> Iterator[Casts]:
    """Yield the casts of views, with processes that make them."""
    folder.mkdir(parents=True, exist_ok=True)
    here = Caster(recipe)
    if workers == 1:
        yield Casts(views, recipe, folder, here)
        return
    with worker_pool(workers, _start, recipe) as pool:
        yield Casts(views, recipe, folder, here, pool)


_caster: Caster | None = None


def _start(recipe: Recipe) -> None:
    global _caster  # noqa: PLW0603 - a worker's only state: the world and the actors' shapes
    _caster = Caster(recipe)


def _cast(mounted: MountedSensor, model: int, path: Path) -> None:
    assert _caster is not None
    write_sighting(path, _caster.cast(mounted, model))
