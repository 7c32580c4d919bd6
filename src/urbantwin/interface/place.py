"""Default paths of results: beside their inputs."""

from __future__ import annotations

import os
import re
from pathlib import Path

from urbantwin.artefact import kind_of

__all__ = ["AnyPath", "beside", "folder_of_site"]

#: A path as given by users; every result counts as the path of its folder or file.
AnyPath = str | os.PathLike[str]


def beside(made_from: AnyPath, name: str, out: AnyPath | None = None) -> Path:
    """Return ``out``, or a path named ``name`` beside the input of a result.

    Artefacts are never nested: beside a part of a dataset means beside the dataset.
    """
    if out is not None:
        return Path(out)
    place = Path(made_from)
    for above in place.resolve().parents:
        if kind_of(above) is not None:
            place = above
    return place.parent / name


def folder_of_site(site: AnyPath, name: str, out: AnyPath | None = None) -> Path:
    """Return ``out``, or the folder for all results of a site: ``NAME`` beside its file.

    Args:
        site: the ``site.yaml``.
        name: name of the site; characters that file systems reject are replaced.
        out: requested folder.
    """
    if out is not None:
        return Path(out)
    plain = re.sub(r'[\s/\\:*?"<>|\x00-\x1f]+', "-", name).strip(" .-")
    return Path(site).parent / (plain or Path(site).stem)
