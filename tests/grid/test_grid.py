"""Cells of designs, and a journal of what is done."""

import itertools
from pathlib import Path

import pytest

from urbantwin.errors import InputError, StageError
from urbantwin.grid import Axis, Journal, factorial, one_at_a_time

AXES = (Axis("rain", ("none", 200)), Axis("sway", (0, 0.01, 0.03)))


def test_one_at_a_time_moves_one_axis_from_the_base() -> None:
    cells = one_at_a_time(AXES)
    assert [one.name(AXES) for one in cells] == ["base", "rain=200", "sway=0.01", "sway=0.03"]
    assert all(len(one.other(AXES)) <= 1 for one in cells)


def test_factorial_has_every_combination_once_the_base_first() -> None:
    cells = factorial(AXES)
    assert [tuple(one.levels.values()) for one in cells] == list(
        itertools.product(*(one.levels for one in AXES))
    )
    assert cells[0].name(AXES) == "base"
    with pytest.raises(InputError, match="1048576 combinations"):
        factorial([Axis(f"a{k}", (0, 1)) for k in range(20)])


def test_a_level_that_is_there_twice_is_found_however_it_is_written() -> None:
    assert Axis("a", (0, 1, 1.0)).twice() == 1
    assert Axis("a", ("none", "b", "none")).twice() == "none"
    assert Axis("a", (0, 1, "1")).twice() is None


def test_what_is_done_stays_done_and_what_fails_is_tried_once_more(tmp_path: Path) -> None:
    file = tmp_path / "cells.jsonl"
    tried: list[str] = []

    def fails(times: int, name: str) -> None:
        tried.append(name)
        if tried.count(name) <= times:
            raise StageError(f"{name} fell over")

    journal = Journal(file)
    assert journal.once("a", lambda: fails(0, "a"))
    assert journal.once("b", lambda: fails(1, "b"))
    assert not journal.once("c", lambda: fails(2, "c"))
    assert tried == ["a", "b", "b", "c", "c"]
    again = Journal(file)  # another run
    assert again.is_done("a")
    assert again.is_done("b")
    assert again.why("c") == "c fell over"
    assert again.once("a", lambda: fails(0, "a"))
    assert again.once("c", lambda: fails(2, "c"))
    assert tried == ["a", "b", "b", "c", "c", "c"]
    again.forget("a")
    assert not again.is_done("a")


def test_what_is_wrong_is_not_tried_again(tmp_path: Path) -> None:
    tried = []

    def wrong() -> None:
        tried.append(1)
        raise InputError("is wrong")

    with pytest.raises(InputError):
        Journal(tmp_path / "cells.jsonl").once("a", wrong)
    assert tried == [1]


def test_a_line_that_was_cut_off_counts_for_nothing(tmp_path: Path) -> None:
    file = tmp_path / "cells.jsonl"
    journal = Journal(file)
    journal.note("a", state="done")
    journal.note("b", state="done")
    whole = file.read_bytes()
    file.write_bytes(whole[:-5])
    again = Journal(file)
    assert again.is_done("a")
    assert not again.is_done("b")
    again.note("b", state="done")
    assert file.read_bytes() == whole


@pytest.mark.parametrize("text", ["{\n", "[]\n", '{"cell": 3}\n', '{"cells": {"a": 1}}\n'])
def test_a_damaged_journal_is_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cells.jsonl"
    file.write_text(text)
    with pytest.raises(InputError, match=r"cells\.jsonl"):
        Journal(file)
