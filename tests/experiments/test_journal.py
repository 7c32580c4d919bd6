"""The journal of an experiment: a finished step is known by its place and its key."""

from pathlib import Path

import pytest

from urbantwin.errors import InputError, StageError
from urbantwin.experiments.journal import JOURNAL, Journal


class Tried:
    """Makes files, of which some fail at first."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def __call__(self, file: Path, failures: int = 0) -> None:
        self.names.append(file.name)
        if self.names.count(file.name) <= failures:
            raise StageError(f"{file.name} fell over")
        file.touch()


def test_what_is_done_stays_done_and_what_fails_is_tried_once_more(tmp_path: Path) -> None:
    tried = Tried()
    journal = Journal(tmp_path)
    assert journal.once("a", "1", tried)
    assert journal.once("b", "1", lambda file: tried(file, 1), attempts=2)
    with pytest.raises(StageError, match="c fell over"):
        journal.once("c", "1", lambda file: tried(file, 2), attempts=2)
    assert tried.names == ["a", "b", "b", "c", "c"]
    again = Journal(tmp_path)  # another run
    assert again.is_done("a", "1")
    assert again.row("c")["why"] == "c fell over"
    assert not again.once("a", "1", tried)
    assert again.once("c", "1", lambda file: tried(file, 2), attempts=2)
    assert tried.names == ["a", "b", "b", "c", "c", "c"]


def test_another_input_and_an_output_that_is_gone_are_made_again(tmp_path: Path) -> None:
    tried = Tried()
    for key in ("1", "2", "2"):
        Journal(tmp_path).once("a", key, tried)
    assert tried.names == ["a", "a"]
    (tmp_path / "a").unlink()
    assert Journal(tmp_path).once("a", "2", tried)
    assert not Journal(tmp_path).is_done("a", "1")


def test_what_is_wrong_is_not_tried_again(tmp_path: Path) -> None:
    tried = []

    def wrong(file: Path) -> None:
        tried.append(file)
        raise InputError("is wrong")

    with pytest.raises(InputError):
        Journal(tmp_path).once("a", "1", wrong, attempts=2)
    assert tried == [tmp_path / "a"]


def test_a_line_that_was_cut_off_counts_for_nothing(tmp_path: Path) -> None:
    file = tmp_path / JOURNAL
    journal = Journal(tmp_path)
    for name in "ab":
        (tmp_path / name).touch()
        journal.note(name, state="done", key="1")
    whole = file.read_bytes()
    file.write_bytes(whole[:-5])
    again = Journal(tmp_path)
    assert again.is_done("a", "1")
    assert not again.is_done("b", "1")
    again.note("b", state="done", key="1")
    assert file.read_bytes() == whole


@pytest.mark.parametrize("text", ["{\n", "[]\n", '{"cell": 3}\n', '{"cells": {"a": 1}}\n'])
def test_a_damaged_journal_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "steps.jsonl").write_text(text)
    with pytest.raises(InputError, match=r"steps\.jsonl"):
        Journal(tmp_path, "steps.jsonl")
