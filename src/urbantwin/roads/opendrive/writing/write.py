"""Writing a lane model as OpenDRIVE."""

from __future__ import annotations

from pathlib import Path

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive.writing.carla import with_carla_crosswalks, with_carla_signs
from urbantwin.roads.opendrive.writing.carla_stages import with_carla_stages
from urbantwin.roads.opendrive.writing.document import document
from urbantwin.roads.opendrive.writing.left_hand_traffic import as_right_hand_traffic

__all__ = ["VERSIONS", "write_opendrive"]

#: Versions of the standard that are written: the newest, and the one that CARLA reads.
VERSIONS = ("1.8", "1.4")


def write_opendrive(
    model: LaneModel, frame: SiteFrame, path: Path, *, version: str = "1.8", name: str
) -> None:
    """Write a lane model as an OpenDRIVE file, whole or not at all.

    Ids are the model's. In 1.4, which is for CARLA, left-hand traffic takes the form of right-hand
    traffic (``as_right_hand_traffic``), crosswalks lie where CARLA finds them
    (``with_carla_crosswalks``), signs have the numbers that it knows (``with_carla_signs``), and
    controllers are what it takes them for (``with_carla_stages``).

    Args:
        model: the lane model, with heights.
        frame: the site frame, which becomes the file's ``geoReference``.
        path: the ``.xodr`` to write.
        version: ``1.8``, or ``1.4`` for CARLA.
        name: the map's name.

    Raises:
        InputError: the version is not one that we write, or the model has no roads.
    """
    if version not in VERSIONS:
        raise InputError(
            f"OpenDRIVE {version!r} is not written", expected=f"one of {', '.join(VERSIONS)}"
        )
    if not model.roads:
        raise InputError("there are no roads to write", file=path)
    if version == "1.4":
        model = with_carla_crosswalks(as_right_hand_traffic(model))
        model = with_carla_signs(with_carla_stages(model))
    content = document(model, frame, version=version, name=name)
    with replaced_file(path, kind="opendrive") as scratch:
        scratch.write_bytes(content)
