"""A signal whose cycle begins later shows everything so much later."""

from collections.abc import Callable
from pathlib import Path

import pytest

from urbantwin.errors import InputError
from urbantwin.traffic import run_traffic
from urbantwin.twin import Twin

LATER_S = 7.0


def shown(signals: list[dict], link: int, time_s: float) -> str:
    return next(
        row["state"] for row in signals[::-1] if row["link"] == link and row["time_s"] <= time_s
    )


@pytest.mark.thorough
def test_an_offset_shifts_what_is_shown(
    crossing_net: Path, twin_of: Callable[..., Twin], tmp_path: Path
) -> None:
    twin = twin_of(tmp_path / "twin", crossing_net, {"car": 60.0}, warmup_s=20.0)
    usual = run_traffic(twin, tmp_path / "usual", seconds=60.0).signals.to_pylist()
    changes = {"signal_offsets": {"c": LATER_S}}
    later = run_traffic(twin, tmp_path / "later", seconds=60.0, changes=changes)
    rows = later.signals.to_pylist()
    links = {row["link"] for row in usual}
    assert len({row["state"] for row in usual}) > 2
    for link in sorted(links):
        for time_s in (LATER_S + 0.35, 21.35, 40.35, 58.35):
            assert shown(rows, link, time_s) == shown(usual, link, time_s - LATER_S)
    assert not list((tmp_path / "later").glob("*.xml"))
    with pytest.raises(InputError, match="no signal program 'x'"):
        run_traffic(twin, tmp_path / "x", seconds=5.0, changes={"signal_offsets": {"x": 1.0}})
