"""How sources of geometry were placed and cleaned: a picture of each."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from urbantwin.drawing.cleaning import cleaning_picture
from urbantwin.drawing.registration import registration_picture
from urbantwin.reconstruct import Reconstruction

__all__ = ["pictures_of_geometry"]


def pictures_of_geometry(
    reconstruction: Reconstruction, out: Path, *, attribution: str | Iterable[str] = ()
) -> list[Path]:
    """Draw ``geometry-N-registration.png`` and ``geometry-N-cleaning.png`` of the N-th source.

    Args:
        reconstruction: what the sources gave.
        out: the folder, made if it is not there.
        attribution: whose data is shown.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = []
    for number, source in enumerate(reconstruction.figures, start=1):
        if source.registration is not None and reconstruction.surroundings is not None:
            drawn.append(
                registration_picture(
                    source.registration,
                    reconstruction.surroundings,
                    out / f"geometry-{number}-registration.png",
                    title=f"{source.name}   registered",
                    attribution=attribution,
                )
            )
        if source.cleaning is not None:
            drawn.append(
                cleaning_picture(
                    source.cleaning,
                    out / f"geometry-{number}-cleaning.png",
                    title=f"{source.name}   cleaned",
                    attribution=attribution,
                )
            )
    return drawn
