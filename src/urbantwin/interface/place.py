"""Where a result goes when nobody says: beside what it is made from."""

from __future__ import annotations

import os
import re
from pathlib import Path

from urbantwin.artefact import kind_of

__all__ = ["AnyPath", "beside", "folder_of_site"]

#: A path as people write it. Every result is one, too: that of its folder or file.
AnyPath = str | os.PathLike[str]


def beside(made_from: AnyPath, name: str, out: AnyPath | None = None) -> Path:
    """Return ``out``, or the place of a name beside what a result is made from.

    Artefacts lie side by side, never one in another: beside a part of a dataset is beside the
    dataset.
    """
    if out is not None:
        return Path(out)
    place = Path(made_from)
    for above in place.resolve().parents:
        if kind_of(above) is not None:
            place = above
    return place.parent / name


def folder_of_site(site: AnyPath, name: str, out: AnyPath | None = None) -> Path:
    """Return ``out``, or the folder for all that is made of a site: ``NAME`` beside its file.

    Args:
        site: the ``site.yaml``.
        name: of the site, without characters that file systems do not take.
        out: what was asked for.
    """
    if out is not None:
        return Path(out)
    plain = re.sub(r'[\s/\\:*?"<>|\x00-\x1f]+', "-", name).strip(" .-")
    return Path(site).parent / (plain or Path(site).stem)
