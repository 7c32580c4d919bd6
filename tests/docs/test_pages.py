"""The pages of docs/: short sentences and lines, the field's words, snippets that can be read."""

import ast
import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from urbantwin.acquire.source_table import SourceSpec
from urbantwin.scene.catalogue.street_object import StreetObject
from urbantwin.traffic.events.scenario import EVENTS

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("**/*.md"))
FENCED = re.compile(r"^ *```.*?^ *```[^\n]*\n?", re.DOTALL | re.MULTILINE)
#: Sentences with more words cannot be understood at first reading.
LONGEST = 40
#: Words of a dialect that the pages no longer speak, where the field has terms of its own.
DIALECT = (
    r"whoever|whomever|is told (?:in|of|by)|it is told|are told|tells of",
    r"\b[Ww]ho (?:drives|walks|waits|stands|comes|looks|rides) [a-z ]+ (?:is|are|has|comes)\b",
    r"sensors? that stands?\b|rigs? that (?:stands?|rides?)\b|what stands\b|who is who",
    r"\basked for\b|is dear\b|\bmended\b|was tried and left|since then",
)


@pytest.fixture(params=PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def page(request: pytest.FixtureRequest) -> Path:
    return request.param


def prose_of(page: Path) -> str:
    """Return the text without code, tables, comments, and targets of links."""
    text = FENCED.sub("\n", page.read_text(encoding="utf-8"))
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    lines = [line for line in text.splitlines() if not line.startswith(("|", "    ", "<", "!["))]
    return re.sub(r"\]\([^)]*\)", "]", "\n".join(lines))


def sentences(text: str) -> Iterator[str]:
    """Yield sentences: parts of paragraphs, items and headings that a full stop or colon ends."""
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )|^#+ .*$", text, flags=re.MULTILINE)
    for block in blocks:
        yield from re.split(r"(?<=[.:;!?])[)*\"]*\s+", re.sub(r"\s+", " ", block))


def test_sentences_are_short(page: Path) -> None:
    long = [one for one in sentences(prose_of(page)) if len(one.split()) > LONGEST]
    assert long == []


def test_lines_are_short(page: Path) -> None:
    """Tables, pictures and a link alone in its line have no other place to break."""
    if page.name == "architecture.md":
        pytest.skip("its tables follow the code")
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if len(line) > 100 and not line.startswith(("|", "![", "<!--")) and " " in line.strip():
            raise AssertionError(f"{page.name}:{number} has {len(line)} characters")


def test_pages_speak_the_words_of_the_field(page: Path) -> None:
    if page.name == "architecture.md":
        pytest.skip("its tables follow the code")
    text = re.sub(r"\s+", " ", prose_of(page))
    assert [found[0] for words in DIALECT for found in re.finditer(words, text)] == []


def blocks(page: Path, language: str) -> list[str]:
    pattern = re.compile(rf"^```{language}\n(.*?)^```", re.DOTALL | re.MULTILINE)
    return pattern.findall(page.read_text(encoding="utf-8"))


#: The models that check the files that people write.
MODELS = (
    "site.site:_SiteFile",
    "site.rig:RigSpec",
    "site.nodes:_Nodes",
    "lidar.sensor_file:_SensorFile",
    "traffic.recorded.description:TracksSpec",
    "studies.placement.place_file:PlaceSpec",
    "experiments.campaign.file:CampaignFile",
    "experiments.study.file:StudyFile",
    "experiments.ladder:CurriculumFile",
    "experiments.suite.file:SuiteFile",
)


@cache
def models() -> list[type[BaseModel]]:
    found = []
    for name in MODELS:
        module, _, model = name.partition(":")
        found.append(getattr(importlib.import_module(f"urbantwin.{module}"), model))
    return found


def test_yaml_has_the_fields_of_a_file_that_people_write(page: Path) -> None:
    """A block may be a part of the file. Values of `site.yaml` fit, too."""
    for block in blocks(page, "yaml"):
        data = yaml.safe_load(block)
        if "pattern" in data:  # of a sensor without columns, read apart from the others
            continue
        if data.keys() == {"sources"}:
            assert all(
                source.keys() <= SourceSpec.model_fields.keys() for source in data["sources"]
            )
            continue
        if data.keys() == {"events"}:
            assert all(event["event"] in EVENTS for event in data["events"])
            continue
        if all(isinstance(value, dict) and "placed" in value for value in data.values()):
            assert all(StreetObject.model_validate(value) for value in data.values())
            continue
        found = [model for model in models() if data.keys() <= names_of(model).keys()]
        assert found, f"no file has the fields {', '.join(data)}"
        for name, value in data.items() if found[0] is models()[0] else ():
            TypeAdapter(names_of(found[0])[name].annotation).validate_python(value)


def names_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


def test_python_names_what_exists(page: Path) -> None:
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            match node:
                case ast.Attribute(ast.Attribute(ast.Name("ut"), group), name) if name.islower():
                    package = importlib.import_module("urbantwin")
                    assert hasattr(getattr(package, group), name), f"ut.{group}.{name}"
                case ast.Attribute(ast.Name("ut"), name):
                    assert hasattr(importlib.import_module("urbantwin"), name), f"ut.{name}"


def test_the_documentation_stays_readable() -> None:
    """Generated tables included; the notebook is not part of it."""
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in PAGES)
    assert words <= 50_000


@pytest.mark.parametrize(
    "words", ["drop-out", "yaw convention", "add my own sensor", "train on my own data"]
)
def test_what_people_search_for_has_a_heading(words: str) -> None:
    heads = [re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M) for page in PAGES]
    assert any(words in head.lower() for several in heads for head in several)
