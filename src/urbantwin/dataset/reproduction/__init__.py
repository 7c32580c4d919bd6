"""Reproducing a dataset from its manifest: what it needs, what differs, and why."""

from urbantwin.dataset.reproduction.reproduce import Plan, make_again, plan_of

__all__ = ["Plan", "make_again", "plan_of"]
