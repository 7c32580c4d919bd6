"""States of signals at a time, for films."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.motion import Motion

__all__ = ["LAMPS", "Lamps"]

#: Colours (0..255) of a link's states, as written by SUMO.
LAMPS = {
    **dict.fromkeys("Gg", (70, 220, 110)),
    **dict.fromkeys("yY", (255, 200, 50)),
    "u": (255, 140, 40),
    "r": (255, 70, 60),
    "s": (255, 70, 60),
}
_DARK = (110, 118, 126)


class Lamps:
    """The links of a motion's signals and their states.

    Args:
        motion: the motion.

    Attributes:
        places: (L, 2) stop line of each link, site frame, metres.
    """

    def __init__(self, motion: Motion) -> None:
        table = motion.signals
        keys = list(
            zip(
                table["signal"].to_pylist(),
                table["link"].to_pylist(),
                table["x"].to_pylist(),
                table["y"].to_pylist(),
                strict=True,
            )
        )
        self._numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
        self._row_link = np.array([self._numbers[key] for key in keys], np.int64)
        self._row_time = np.asarray(table["time_s"].to_numpy(), np.float64)
        self._row_state = table["state"].to_pylist()
        self.places: NDArray[np.float64] = np.array(
            [key[2:] for key in self._numbers], np.float64
        ).reshape(-1, 2)
        self._of_link: dict[tuple[str, int], int] = {}
        for (signal, link, _, _), number in self._numbers.items():
            self._of_link.setdefault((signal, link), number)

    def number(self, program: str, links: tuple[int, ...]) -> int | None:
        """Return the number of the first link of a program in the motion."""
        found = (self._of_link.get((program, link)) for link in links)
        return next((one for one in found if one is not None), None)

    def colours(self, time_s: float) -> list[tuple[int, int, int]]:
        """Return the colour (0..255) of every link at a time."""
        shown = [_DARK] * len(self._numbers)
        for row in range(int(np.searchsorted(self._row_time, time_s + 1e-6, side="right"))):
            shown[self._row_link[row]] = LAMPS.get(self._row_state[row], _DARK)
        return shown
