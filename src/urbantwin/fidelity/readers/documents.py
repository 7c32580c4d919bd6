"""JSON and YAML of datasets: read, or one clear line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from urbantwin.errors import InputError

__all__ = ["laid_out", "read_json_document", "read_yaml_document"]

#: libyaml's parser where it is there: ten times as fast on the labels of a street.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_json_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return what a JSON file holds.

    Raises:
        InputError: missing or not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except (ValueError, RecursionError, OSError) as error:
        raise InputError(f"is not JSON ({error})", file=path, expected=expected) from None


def read_yaml_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return what a YAML file of plain values holds.

    Raises:
        InputError: missing or not YAML.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8-sig"), _LOADER)
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except (yaml.YAMLError, ValueError, RecursionError, OSError) as error:
        raise InputError(f"is not YAML ({error})", file=path, expected=expected) from None


@contextmanager
def laid_out(path: Path, expected: str) -> Iterator[None]:
    """Turn what goes wrong when a document's values are picked into one clear line.

    Raises:
        InputError: a key, a type or a number in the block was not as expected.
    """
    try:
        yield
    except KeyError as error:
        raise InputError(f"lacks {error}", file=path, expected=expected) from None
    except (ValueError, TypeError, IndexError, AttributeError, StopIteration) as error:
        raise InputError(f"is not laid out right ({error})", file=path, expected=expected) from None
