"""Measured background: ranges of the static world that a real, fixed sensor saw in each beam."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["IMAGES", "MeasuredBackground", "Stirring"]

#: Names of a background's images.
IMAGES = ("range_m", "sigma_m", "share", "intensity")


def _no_looks() -> NDArray[np.int32]:
    return np.zeros((0, 0), np.int32)


@dataclass(frozen=True, eq=False)
class Stirring:
    """Ranges of B beams that meet moving vegetation, in Q recorded frames.

    Connected parts move together: all beams of a patch, of any sensor, replay the same recorded
    frame, independently of other patches (block bootstrap).

    Attributes:
        beam: (B,) int32, ascending.
        patch: (B,) int32, id of the patch of vegetation, from 0, common to all sensors of a
            recording.
        range_m: (Q, B) float32, metres; 0: the beam passed the vegetation.
        intensity: (Q, B) float32, 0 to 1; nan: unknown.
        lasts_s: time that a patch keeps its state, seconds; 0: one turn of the sensor.
    """

    beam: NDArray[np.int32]
    patch: NDArray[np.int32]
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    lasts_s: float = 0.0


@dataclass(frozen=True, eq=False)
class MeasuredBackground:
    """Range distribution of each beam of a fixed sensor without traffic.

    A beam has up to M ranges, the most frequent first, for example at an edge, a fence or a tree.

    Attributes:
        range_m: (M, C, K) float32, metres; 0 for none.
        sigma_m: (M, C, K) float32, standard deviation of the range, metres; nan: unknown.
        share: (M, C, K) float32, share of the unobstructed observations that returned from this
            range; nan: unknown, for a beam with one range.
        intensity: (M, C, K) float32, 0 to 1; nan: unknown.
        looks: (C, K) int32, number of unobstructed observations; 0: not counted.
        model: sensor model; empty: any with as many channels and columns.
        turns_per_second: of the sensor; nan: unknown.
        name: name of the sensor in its rig.
        fused: use the modelled scene for beams without a measured range, instead of no return.
        stirring: moving vegetation in front of it; ``None`` for none.
    """

    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    share: NDArray[np.float32]
    intensity: NDArray[np.float32]
    looks: NDArray[np.int32] = field(default_factory=_no_looks)
    model: str = ""
    turns_per_second: float = float("nan")
    name: str = ""
    fused: bool = False
    stirring: Stirring | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Channels and columns."""
        return self.range_m.shape[1], self.range_m.shape[2]

    @property
    def sha256(self) -> str:
        """SHA-256 of all values, which identifies the background in a dataset's manifest."""
        digest = hashlib.sha256(repr((self.range_m.shape, self.fused)).encode())
        for name in (*IMAGES, "looks"):
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        if self.stirring is not None:
            for part in fields(self.stirring):
                value = np.ascontiguousarray(getattr(self.stirring, part.name))
                digest.update(repr(value.shape).encode() + value.tobytes())
        return digest.hexdigest()

    @property
    def known(self) -> NDArray[np.bool_]:
        """Beams (N,) with a measured range."""
        return np.asarray(self.range_m[0].ravel() > 0)

    @property
    def returned(self) -> NDArray[np.float32]:
        """Share (N,) of the unobstructed observations with a return; nan: unknown."""
        total = self.share.sum(axis=0, dtype=np.float32).ravel()
        return np.asarray(np.where(self.known, np.minimum(total, 1), 0), np.float32)
