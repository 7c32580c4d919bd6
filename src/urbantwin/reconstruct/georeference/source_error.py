"""Errors about a source of geometry: line of ``site.yaml``, source, and problem."""

from __future__ import annotations

from urbantwin.errors import InputError
from urbantwin.site.geometry import GeometrySource

__all__ = ["source_error"]


def source_error(
    source: GeometrySource, problem: str, field: str | None = None, *, expected: str | None = None
) -> InputError:
    """Return an error that names the source and its position in ``site.yaml``.

    Args:
        source: the source.
        problem: the reason, which follows the source's name.
        field: field of its entry in ``site.yaml``; the whole entry if not given.
        expected: a remedy.
    """
    place = source.place(field) if field and field in _given(source) else source.place()
    return InputError(
        f"{source.name} {problem}", file=source.document.file, place=place, expected=expected
    )


def _given(source: GeometrySource) -> set[str]:
    given = set(source.spec.model_fields_set)
    return given | {"register"} if "register_to" in given else given
