"""Detection of coupled bodies of articulated vehicles, by the positions of their joints."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.traffic.assets import AssetName, bending_names, bodies_of_asset
from urbantwin.traffic.motion_rows import ActorRows, as_rows

__all__ = ["are_coupled", "towed_by"]

#: Maximum distance between the two halves of a joint, metres.
_JOINT_M = 0.1


def are_coupled(columns: Mapping[str, NDArray[Any]], pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return, for pairs (P, 2) of rows, whether one is coupled to the other.

    Args:
        columns: columns of actors: ``asset``, ``x``, ``y``, ``yaw``.
        pairs: rows of the same step each.
    """
    return _are_coupled_rows(columns, pairs) | _are_coupled_rows(columns, pairs[:, ::-1])


def towed_by(actors: pa.Table | ActorRows) -> dict[int, int]:
    """Return the track of each further body of an articulated vehicle -> that of the body ahead.

    Args:
        actors: rows of a motion.
    """
    ahead = {first for first, _ in _joints()}
    towed_bodies = {second for _, second in _joints()}
    all_rows = as_rows(actors)
    names = all_rows.distinct(["asset"])["asset"].to_pylist()
    rows = all_rows.where(
        "asset", [x for x in names if AssetName.of(x).body in ahead | towed_bodies]
    )
    columns = {
        name: np.asarray(rows[name].to_numpy())
        for name in ("time_s", "track", "asset", "x", "y", "yaw")
    }
    track = columns["track"]
    follows = np.array(
        [AssetName.of(name).body in towed_bodies for name in columns["asset"]], np.bool_
    )
    ahead_of: dict[int, int] = {}
    starts = np.flatnonzero(np.diff(columns["time_s"], prepend=-np.inf))
    for group in np.split(np.arange(len(track)), starts[1:]):
        fresh = [row for row in group.tolist() if follows[row] and int(track[row]) not in ahead_of]
        pairs = [(a, b) for b in fresh for a in group.tolist() if a != b]
        row_pairs = np.array(pairs, np.int64).reshape(-1, 2)
        ahead_of.update(
            (int(track[b]), int(track[a]))
            for a, b in row_pairs[_are_coupled_rows(columns, row_pairs)].tolist()
        )
    return dict(sorted(ahead_of.items()))


def _are_coupled_rows(
    columns: Mapping[str, NDArray[Any]], pairs: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return, for pairs (P, 2) of rows, whether the second is coupled behind the first."""
    is_coupled = np.zeros(len(pairs), np.bool_)
    if not len(pairs):
        return is_coupled
    first, second = pairs.T
    shown = columns["asset"][pairs].astype(str)
    names, which = np.unique(shown, return_inverse=True)
    bodies = [AssetName.of(name).body for name in names.tolist()]
    which = which.reshape(shown.shape)
    kind = which[:, 0] * len(names) + which[:, 1]
    for pair_kind in np.unique(kind).tolist():
        rows = np.flatnonzero(kind == pair_kind)
        for back_m, front_m in _joints().get(
            (bodies[pair_kind // len(names)], bodies[pair_kind % len(names)]), ()
        ):
            apart = _points_ahead(columns, first[rows], -back_m) - _points_ahead(
                columns, second[rows], front_m
            )
            is_coupled[rows] |= np.hypot(*apart.T) < _JOINT_M
    return is_coupled


def _points_ahead(
    columns: Mapping[str, NDArray[Any]], rows: NDArray[np.int64], ahead_m: float
) -> NDArray[np.float64]:
    """Return the points (R, 2) at a distance ahead of the centres of rows."""
    yaw = columns["yaw"][rows]
    middle = np.column_stack([columns["x"][rows], columns["y"][rows]])
    return np.asarray(middle + ahead_m * np.column_stack([np.cos(yaw), np.sin(yaw)]))


@cache
def _joints() -> dict[tuple[str, str], tuple[tuple[float, float], ...]]:
    """Return the joint's distance behind the centre of a body, and ahead of that of the next."""
    joints: dict[tuple[str, str], set[tuple[float, float]]] = {}
    for name in bending_names():
        for leading, following in pairwise(bodies_of_asset(name)):
            joint_m = following.guides_m[0]
            places = joint_m - leading.middle_m, following.middle_m - joint_m
            joints.setdefault((leading.asset, following.asset), set()).add(places)
    return {pair: tuple(sorted(places)) for pair, places in joints.items()}
