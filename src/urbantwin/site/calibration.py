"""Calibration of a sensor unit: deviations from the datasheet of its model."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, wrong
from urbantwin.taxonomy import materials

__all__ = ["Calibration", "Reflectivities"]

Factor = Annotated[float, Field(ge=0.01, le=10.0, allow_inf_nan=False)]


class Calibration(Strict):
    """Deviations of a unit from its datasheet; the defaults are the datasheet.

    Attributes:
        range_noise: factor on the datasheet's standard deviation; part of the effect ``noise``.
        range_offset_m: offset added to every range, metres.
        light: factor on the strength of every echo: a dirty window, an aged laser.
        intensity: factor on the reported intensity.
        missing: fraction of beams without any return; part of ``dropout``.
    """

    range_noise: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] = 1.0
    range_offset_m: Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)] = 0.0
    light: Factor = 1.0
    intensity: Factor = 1.0
    missing: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0


def _of_the_table(value: dict[str, float]) -> dict[str, float]:
    for name in value:
        if name not in materials():
            raise wrong(f"there is no material {name!r:.40}", nearest(name, list(materials())))
    return value


#: Factors on the reflectivity of the table of materials, by name of the material.
Reflectivities = Annotated[dict[str, Factor], AfterValidator(_of_the_table)]
