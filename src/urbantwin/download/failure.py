"""The error of a download."""

from __future__ import annotations

__all__ = ["DownloadError"]


class DownloadError(Exception):
    """Something could not be downloaded; the text is one line, and no key is part of it.

    Args:
        problem: what is wrong, after the name of what was asked for: ``not found (404)``.
        status: the server's status, if it answered with one that is not good.
        unanswered: the server could not be reached, or broke off.
        may_pass: the same request may do better a moment later.
        after_s: how long the server asks to wait before it is asked again, seconds.
        spent: what may be downloaded altogether has been: asking for more is of no use.
    """

    def __init__(
        self,
        problem: str,
        *,
        status: int | None = None,
        unanswered: bool = False,
        may_pass: bool = False,
        spent: bool = False,
        after_s: float | None = None,
    ) -> None:
        super().__init__(problem)
        self.status = status
        self.unanswered = unanswered
        self.may_pass = may_pass
        self.spent = spent
        self.after_s = after_s
