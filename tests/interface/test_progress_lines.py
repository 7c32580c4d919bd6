"""What a person who waits is told, where stderr is no terminal."""

import re
import time

import pytest

from urbantwin.interface.stage import _lines


def shares(text: str) -> list[int]:
    return [int(found) for found in re.findall(r": (\d+)%", text)]


def test_who_waits_gets_lines_though_nothing_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with _lines("paint", longest_s=0.05) as tell:
        tell(0.3, "drying")
        time.sleep(0.6)
    lines = capsys.readouterr().err.splitlines()
    assert sum("30%, drying" in line and "so far" in line for line in lines) >= 3
    assert lines[-1].startswith("paint: done in ")


def test_the_share_never_falls(capsys: pytest.CaptureFixture[str]) -> None:
    with _lines("paint", longest_s=0.0) as tell:
        for share in (0.1, 0.5, 0.4, 0.0, 0.6):
            tell(share, "coats")
    found = shares(capsys.readouterr().err)
    assert found == sorted(found)
    assert {10, 50, 60} <= set(found)


def test_a_stage_that_is_over_at_once_may_say_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with _lines("look", brief=True) as tell:
        tell(0.5, "at it")
    assert capsys.readouterr().err == ""


def test_nothing_is_said_after_a_failure(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="spilt"), _lines("paint", longest_s=0.01):
        raise ValueError("spilt")
    told = capsys.readouterr().err
    time.sleep(0.1)
    assert "done" not in told
    assert capsys.readouterr().err == ""
