"""What a person who waits is told, where stderr is no terminal, and in a notebook."""

import re
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from urbantwin.interface.stage import _lines, shown_stage, tell_result
from urbantwin.result_warning import ResultWarning


def shares(text: str) -> list[int]:
    return [int(found) for found in re.findall(r": (\d+)%", text)]


def test_who_waits_gets_lines_though_nothing_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with _lines("paint", longest_s=0.05) as tell:
        tell(0.3, "drying")
        time.sleep(0.6)
    lines = capsys.readouterr().err.splitlines()
    assert sum("30%, drying" in line and "so far" in line for line in lines) >= 3
    assert lines[-1].startswith("paint: done in ")


def test_a_result_is_told_where_progress_is_shown(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told = [ResultWarning("crossings", "2 of 3 are there"), ResultWarning("points", "none")]
    for progress in (False, lambda share, doing: None):
        tell_result("paint", tmp_path, told, progress)
        assert capsys.readouterr() == ("", "")
    tell_result("paint", tmp_path, told, True)
    out, err = capsys.readouterr()
    assert (out, err.splitlines()) == (
        "",
        ["warning: crossings: 2 of 3 are there", "warning: points: none"],
    )
    (tmp_path / "pictures").mkdir()
    tell_result("paint", tmp_path, (), True)
    assert capsys.readouterr().err == f"paint: pictures in {tmp_path / 'pictures'}\n"


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


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What a notebook's cell shows, drawing by drawing: IPython with a kernel, and its display."""
    drawn: list[str] = []
    display = SimpleNamespace(
        HTML=lambda text: text,
        display=lambda text, display_id: drawn.append(text) or SimpleNamespace(update=drawn.append),
    )
    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object()))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return drawn


def test_a_notebook_gets_a_bar(notebook: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with shown_stage("paint") as tell:
        tell(0.25, "coat <1>")
        tell(0.5, "coat <2>")  # too soon to be drawn
    assert [re.search(r'value="([\d.]+)"', one).group(1) for one in notebook] == [
        "0.2500",
        "1.0000",
    ]
    assert "paint 25%, 0 s: coat &lt;1&gt;" in notebook[0]
    assert notebook[-1].endswith("done")
    assert capsys.readouterr() == ("", "")


def test_a_notebook_sees_where_a_stage_stopped(notebook: list[str]) -> None:
    with pytest.raises(KeyboardInterrupt), shown_stage("paint") as tell:
        tell(0.25, "coat 1")
        raise KeyboardInterrupt
    assert notebook[-1].endswith("stopped (coat 1)")


def test_a_stage_that_is_over_at_once_draws_nothing_in_a_notebook(notebook: list[str]) -> None:
    with shown_stage("look", brief=True) as tell:
        tell(0.5, "at it")
    assert notebook == []


def test_who_wants_silence_or_asks_to_be_told(capsys: pytest.CaptureFixture[str]) -> None:
    with shown_stage("paint", False) as tell:
        tell(0.5, "coat 1")
    told: list[tuple[float, str]] = []
    with shown_stage("paint", lambda share, doing: told.append((share, doing))) as tell:
        tell(0.5, "coat 2")
    assert told == [(0.5, "coat 2")]
    assert capsys.readouterr() == ("", "")
