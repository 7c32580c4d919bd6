"""Nodes of a run: rigs on poles or vehicles, and the times of their presence."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.dataset.motion_interpolation import FASTEST_M_S
from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.lidar import Rig
from urbantwin.lidar.riding import boarded_while_there, while_there
from urbantwin.lidar.rig import dataset_frame
from urbantwin.site.nodes import NodesFile, NodeSpec
from urbantwin.site.rig import RideSpec, RigSpec

if TYPE_CHECKING:
    from urbantwin.traffic import Motion

__all__ = ["Node", "PlacedRig", "placed_nodes", "seed_of"]


@dataclass(frozen=True, eq=False)
class PlacedRig:
    """A node's rig, placed on the site, before a carrier is assigned.

    Attributes:
        spec: as requested.
        rig: as placed.
        file: its file.
        field: field of that file that holds it; empty: all of it.
    """

    spec: RigSpec
    rig: Rig
    file: Path
    field: str = ""


@dataclass(frozen=True, eq=False)
class Node:
    """One node of a run.

    Attributes:
        spec: as requested.
        rig: its rig, with the carrier assigned.
        rig_spec: the requested rig, with its carrier as a track.
        rig_file: file of that.
        seed: seed of all its random effects.
        times_s: frame number -> time, of the frames in which it is present.
        spans_s: intervals of its carrier's presence; ``None``: fixed.
    """

    spec: NodeSpec
    rig: Rig
    rig_spec: RigSpec
    rig_file: Path
    seed: int
    times_s: Mapping[int, float]
    spans_s: Sequence[tuple[float, float]] | None = None

    @property
    def name(self) -> str:
        """Its name, also of its folder."""
        return self.spec.name

    @property
    def site_SE3_standing(self) -> Pose:  # noqa: N802
        """Pose of a fixed node: upright at its first sensor, with that sensor's heading."""
        return dataset_frame("level", self.rig.sensors[0].site_SE3_sensor)


def placed_nodes(
    asked: NodesFile,
    rigs: Sequence[PlacedRig],
    motion: Motion,
    times_s: Mapping[int, float],
    seed: int,
) -> tuple[Node, ...]:
    """Return the nodes of a run, each on its own carrier.

    Nodes that ask for a track are assigned first, then those that ask for a class, in the order of
    the file: every node has another actor.

    Args:
        asked: the nodes.
        rigs: the rig of each.
        motion: the motion.
        times_s: frame number -> time, of the run.
        seed: seed of the run.

    Raises:
        InputError: two nodes ask for one actor, a carrier is absent in all frames, or the rigs
            differ in what all nodes must share.
    """
    _check_alike(asked, rigs)
    numbers, times = list(times_s), list(times_s.values())
    order = sorted(range(len(rigs)), key=lambda k: _rank(rigs[k].rig))
    taken: dict[int, str] = {}
    found: dict[int, Node] = {}
    for k in order:
        spec, one = asked.nodes[k], rigs[k]
        own = spec.seed if spec.seed is not None else seed_of(seed, spec.name, first=k == 0)
        rig, rig_spec, spans, there = one.rig, one.spec, None, np.ones(len(times), np.bool_)
        if rig.ride is not None:
            where: tuple[int | str, ...] = ("nodes", k)
            track = rig.ride.track
            if track in taken:
                raise asked.document.error(
                    f"{spec.name} and {taken[track]} are mounted on the same actor, track {track}",
                    (*where, "ride") if spec.ride is not None else where,
                    "another track, or one rig with the sensors of both",
                )
            with _carrier_named(asked, k, one):
                rig, spans = boarded_while_there(
                    rig, motion, times, taken=taken, fastest_m_s=FASTEST_M_S, file=str(one.file)
                )
            assert rig.carrier is not None
            taken[rig.carrier] = spec.name
            # The reproduced dataset must not search for a carrier again.
            rig_spec = rig_spec.model_copy(update={"ride": RideSpec(track=rig.carrier)})
            there = while_there(times, spans)
        own_times = {numbers[n]: times[n] for n in np.flatnonzero(there).tolist()}
        found[k] = Node(spec, rig, rig_spec, one.file, own, own_times, spans)
    return tuple(found[k] for k in range(len(rigs)))


def seed_of(seed: int, name: str, *, first: bool = False) -> int:
    """Return the seed of a node: the run's for the first, otherwise derived from that and its name.

    Nodes must not share noise, or lose the same frames.
    """
    if first:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:4]) >> 1


@contextmanager
def _carrier_named(asked: NodesFile, number: int, placed: PlacedRig) -> Iterator[None]:
    """Add the field of the nodes' file to errors about a node's carrier."""
    try:
        yield
    except InputError as error:
        place = error.place or ""
        at: tuple[int | str, ...] = ("nodes", number)
        if place.startswith("ride") and asked.nodes[number].ride is not None:
            raise asked.document.error(error.problem, (*at, "ride"), error.expected) from None
        if not placed.field:
            raise
        raise InputError(
            error.problem,
            file=placed.file,
            place=f"{placed.field}.{place}",
            expected=error.expected,
        ) from None


def _rank(rig: Rig) -> int:
    """Return the order of assignment: nodes with fewer possible carriers first."""
    return 0 if rig.ride is None else 1 if rig.ride.track is not None else 2


def _check_alike(asked: NodesFile, rigs: Sequence[PlacedRig]) -> None:
    """Check that the rigs share frame rate and labels."""
    says: list[tuple[str, str, Callable[[Rig], Any]]] = [
        ("frames per second", "rate_hz: of all nodes", lambda rig: rig.rate_hz),
        ("boxes", "the same boxes: in the rig of each", lambda rig: rig.boxes),
    ]
    for what, expected, value in says:
        for k, one in enumerate(rigs[1:], start=1):
            mine, theirs = value(one.rig), value(rigs[0].rig)
            if mine != theirs:
                raise asked.document.error(
                    f"{asked.nodes[k].name} has {mine} {what}, {asked.nodes[0].name} {theirs}",
                    ("nodes", k, "rig"),
                    expected,
                )
