"""Cleaning of imported geometry: cropped, without shards and traffic, decimated; and a report."""

from urbantwin.reconstruct.cleaning.clean import Cleaned, CleaningPicture, cleaned
from urbantwin.reconstruct.cleaning.decimate import unseen_error
from urbantwin.reconstruct.cleaning.removal import Removal

__all__ = ["Cleaned", "CleaningPicture", "Removal", "cleaned", "unseen_error"]
