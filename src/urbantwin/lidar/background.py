"""A measured background: at which ranges a real, fixed sensor saw the static world, by beam."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["IMAGES", "MeasuredBackground", "Stirring"]

#: The images of a background by their names.
IMAGES = ("range_m", "sigma_m", "share", "intensity")


def _no_looks() -> NDArray[np.int32]:
    return np.zeros((0, 0), np.int32)


@dataclass(frozen=True, eq=False)
class Stirring:
    """At which ranges B beams met matter that stirs, in Q of the frames that measured it.

    What hangs together moves together: all beams of a patch, of whichever sensor, see what they saw
    in one of these frames, and another patch what it was in another (a bootstrap by blocks).

    Attributes:
        beam: (B,) int32, ascending.
        patch: (B,) int32, the part of the world that it meets there, from 0; the same numbers for
            all sensors of a recording.
        range_m: (Q, B) float32, metres; 0: the beam met nothing that stirs.
        intensity: (Q, B) float32, 0 to 1; nan: not known.
        lasts_s: how long a patch stays as it is, seconds; 0: a turn of the sensor.
    """

    beam: NDArray[np.int32]
    patch: NDArray[np.int32]
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    lasts_s: float = 0.0


@dataclass(frozen=True, eq=False)
class MeasuredBackground:
    """What each beam of a fixed sensor finds when nothing moves before it.

    A beam has up to M ranges, the most frequent first: an edge, a fence, a tree.

    Attributes:
        range_m: (M, C, K) float32, metres; 0 where there is none.
        sigma_m: (M, C, K) float32, standard deviation of the range, metres; nan: not known.
        share: (M, C, K) float32, of the unobstructed looks, those that came back from there; nan:
            not known, of a beam with one range.
        intensity: (M, C, K) float32, 0 to 1; nan: not known.
        looks: (C, K) int32, how many were unobstructed; 0: not counted.
        model: of the sensor; empty: any that has as many channels and columns.
        turns_per_second: of it; nan: not known.
        name: of the sensor in its rig.
        fused: beams without a measured range see the modelled scene, in place of nothing.
        stirring: what stirs before it; ``None``: nothing does.
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
        """The hash of all its values: what a recipe knows it by."""
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
        """Which beams (N,) have a measured range."""
        return np.asarray(self.range_m[0].ravel() > 0)

    @property
    def returned(self) -> NDArray[np.float32]:
        """Share (N,) of the unobstructed looks that came back; nan: not known."""
        total = self.share.sum(axis=0, dtype=np.float32).ravel()
        return np.asarray(np.where(self.known, np.minimum(total, 1), 0), np.float32)
