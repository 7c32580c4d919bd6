"""Up axis and unit of a model, as stated or estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.ground_level import samples_of
from urbantwin.reconstruct.georeference.similarity import Similarity
from urbantwin.site.geometry import GeometrySource

__all__ = ["UNITS", "Axes", "axes_of"]

#: Length of units in metres; the US survey foot as before 2022 (NIST SP 811, B.6).
UNITS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "km": 1000.0,
    "ft": 0.3048,
    "us-ft": 1200 / 3937,
    "in": 0.0254,
}


@dataclass(frozen=True)
class Axes:
    """Up axis and unit of a model.

    Attributes:
        up: ``"y"`` or ``"z"``.
        up_why: source of the up axis, for reports.
        up_known: whether it is stated instead of estimated.
        unit_m: length of the unit, metres.
        unit_why: source of the unit, for reports.
        unit_known: whether it is stated instead of estimated.
    """

    up: str
    up_why: str
    up_known: bool
    unit_m: float
    unit_why: str
    unit_known: bool

    def transform(self) -> Similarity:
        """Return the transform to z-up and metres."""
        return Similarity.of_axes(self.up, self.unit_m)

    def as_report(self) -> dict[str, object]:
        """Return the entry of a report."""
        return {
            "up": self.up,
            "up_why": self.up_why,
            "unit_m": float(f"{self.unit_m:.9g}"),
            "unit_why": self.unit_why,
        }


def axes_of(model: ImportedModel, source: GeometrySource) -> Axes:
    """Return a model's up axis and unit, from ``site.yaml``, the file, or an estimate."""
    spec = source.spec
    up: str = spec.up
    why, known = "site.yaml says so", True
    if up == "auto" and model.up is not None:
        up, why = model.up, "the file says so"
    elif up == "auto":
        known = False
        up, why = _found_up(model)
    length, said, sure = 1.0, "site.yaml says so", True
    if spec.unit != "auto":
        length = UNITS[spec.unit] if isinstance(spec.unit, str) else float(spec.unit)
    elif model.unit_m is not None:
        length, said = model.unit_m, "the file says so"
    else:
        sure = False
        length, said = _found_unit(model, up)
    return Axes(up, why, known, length, said, sure)


def _found_up(model: ImportedModel) -> tuple[str, str]:
    """Return the axis that most level surfaces face, otherwise the one of the smallest extent."""
    samples = samples_of(model)
    if len(samples.points) == 0:
        return "z", "nothing to tell it by: z is usual for surveys"
    if samples.normals is not None:
        share = (np.abs(samples.normals) > np.cos(np.radians(15.0))).mean(axis=0)
        x, y, z = (float(one) for one in share)
        if max(y, z) > 1.25 * min(y, z) and max(y, z) > 0.8 * x:
            up = "y" if y > z else "z"
            return (
                up,
                f"found: {max(y, z):.0%} of its surface faces {up}, {min(y, z):.0%} the other",
            )
    low, high = np.quantile(samples.points, [0.02, 0.98], axis=0)
    extent = high - low
    up = "y" if extent[1] < extent[2] else "z"
    return up, f"found: it extends least along {up}"


def _found_unit(model: ImportedModel, up: str) -> tuple[float, str]:
    """Return the unit in which a model has the size of an urban place."""
    samples = samples_of(model)
    if len(samples.points) == 0:
        return 1.0, "nothing to tell it by: metres"
    points = samples.points[:, [0, 2]] if up == "y" else samples.points[:, :2]
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    extent = float((high - low).max())
    if extent <= 0 or 20.0 <= extent <= 5000.0:
        return 1.0, f"found: {extent:.4g} across are metres, as of a place in a town"
    # An extent cannot distinguish feet from metres: only clear deviations are other units.
    for unit, name in ((0.001, "millimetres"), (0.01, "centimetres"), (1000.0, "kilometres")):
        if 30.0 <= extent * unit <= 3000.0:
            return unit, f"found: {extent:.4g} across are taken for {name}"
    return 1.0, f"nothing fits an extent of {extent:.4g}: metres"
