"""Numbers, JSON and messages of files that nobody vouches for."""

import json
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from urbantwin.errors import InputError, StageError, readable
from urbantwin.number_text import finite_number, plain_number, whole_number
from urbantwin.strict_json import NotJsonError, parse_json


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_number_comes_back(value):
    assert finite_number(repr(value)) == value
    assert parse_json(json.dumps({"a": [value]})) == {"a": [value]}


@given(st.integers(-(2**63), 2**63 - 1))
@example(2**63 - 1)
@example(-(2**63))
@example(2**53 + 1)
def test_every_whole_number_of_64_bits_comes_back(value):
    assert parse_json(str(value).encode()) == value
    assert isinstance(parse_json(str(value)), int)
    assert whole_number(str(value)) == value
    assert whole_number(f"{'-' if value < 0 else ''}000{abs(value)}") == value


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 10**19, -(10**40), 10**4000])
def test_whole_numbers_of_more_bits_are_none(value):
    text = f"{value:d}"
    assert whole_number(text) is None


@pytest.mark.parametrize(
    "text", ["", None, "1_0", "１２", "²", "nan", "-inf", "1e400", "9" * 5000, "0x10", "--1", "1 2"]
)
def test_what_is_no_number(text):
    assert finite_number(text) is None
    assert whole_number(text) is None


def test_plain_numbers_may_be_without_end():
    assert math.isnan(plain_number("nan"))
    assert plain_number(" 1.5e3 ") == 1500
    with pytest.raises(ValueError, match="no number"):
        plain_number("1_0")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"a":\n NaN}', "holds NaN, which is not a finite number in line 2"),
        ("[-Infinity]", "holds -Infinity"),
        ("[1e400]", "holds 1e400"),
        ("[" + "9" * 5000 + "]", "holds 99999999999999999999, which"),
        ("[" * 100_000, "nested too deep"),
        ('{"a": 1,}', "in line 1"),
        ("", "in line 1"),
        (b'{"a": "\xff"}', "no text"),
    ],
)
def test_what_is_no_json(text, told):
    with pytest.raises(NotJsonError) as caught:
        parse_json(text)
    assert told in str(caught.value)
    assert len(str(caught.value)) < 100


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_json_in_every_encoding_of_the_standard(encoding):
    assert parse_json('{"a": "é"}'.encode(encoding)) == {"a": "é"}


def test_whole_numbers_beyond_all_counts_are_floats():
    assert parse_json(str(10**30)) == 1e30


@given(st.text(max_size=3000), st.text(min_size=1, max_size=100))
def test_a_message_is_one_short_line_that_moves_no_cursor(problem, place):
    for error in (InputError(problem, file=problem, place=place, expected=problem),
                  StageError(problem)):  # fmt: skip
        text = str(error)
        assert text.isprintable()
        assert "\n" not in text
        assert len(text) <= 1400
    assert str(InputError("is bad", file="a.osm")) == "a.osm: is bad"


def test_a_long_value_loses_its_middle():
    text = str(InputError("x" * 75_000 + "the end", file="map.osm", expected="an extract"))
    assert text.startswith("map.osm: xxx")
    assert " ... " in text
    assert text.endswith("the end; expected an extract")
    assert readable("\x1b[31mred\x1b[0m \u202e") == r"\x1b[31mred\x1b[0m \u202e"
    assert readable("plain   words\n here") == "plain words here"
    assert readable("Königsworther Platz 交差点") == "Königsworther Platz 交差点"
