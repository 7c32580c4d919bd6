"""One pose from several frames of a sensor that stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.align import Alignment
from urbantwin.geometry import Pose

__all__ = ["averaged"]

#: Frames farther apart than this, and than three times what they claim, are of a moving sensor.
_APART_M, _APART_DEG = 0.5, 3.0


def averaged(found: Sequence[Alignment], file: str | None = None) -> Alignment:
    """Return the mean pose; residuals and shares are those of the frame that is nearest to it.

    Frames of one place err alike wherever the twin is wrong: the standard deviations are the
    frames' own (root mean square), not less by their number, and their scatter is added.

    Args:
        found: of each frame, at least one.
        file: where the frames are from, for errors.

    Raises:
        InputError: the frames are from different places.
    """
    if len(found) == 1:
        return found[0]
    turns = Rotation.from_matrix(np.stack([one.pose.rotation for one in found]))
    places = np.stack([one.pose.translation for one in found])
    turn, place = turns.mean(), places.mean(axis=0)
    off = np.linalg.norm(places - place, axis=1)
    turned = (turns * turn.inv()).as_rotvec()
    claimed = np.stack([one.found.sigma_m for one in found])
    apart = float(np.ptp(places, axis=0).max())
    most = max(_APART_M, 6.0 * float(np.linalg.norm(claimed, axis=1).max()))
    if apart > most or np.degrees(np.abs(turned)).max() > _APART_DEG:
        raise InputError(
            f"its frames are from places {apart:.2f} m and "
            f"{2 * np.degrees(np.abs(turned)).max():.1f} degrees apart",
            file=file,
            expected="frames of a sensor that stands still, or one frame",
        )
    nearest = found[int(off.argmin())]
    count = len(found)
    claimed_deg = np.stack([one.found.sigma_deg for one in found])
    sigma_m = np.sqrt((claimed**2).mean(axis=0) + places.var(axis=0, ddof=1) / count)
    spread = np.degrees(turned).var(axis=0, ddof=1) / count
    pose = Pose(turn.as_matrix(), place)
    return replace(
        nearest,
        pose=pose,
        found=replace(
            nearest.found,
            pose=pose,
            sigma_m=sigma_m,
            sigma_deg=np.sqrt((claimed_deg**2).mean(axis=0) + spread),
        ),
        frames=count,
        scatter_m=float(np.sqrt((off**2).mean())),
    )
