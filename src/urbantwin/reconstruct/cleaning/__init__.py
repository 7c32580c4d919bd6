"""Cleaning of imported geometry: cropping, removal of shards and traffic, decimation; a report."""

from urbantwin.reconstruct.cleaning.clean import Cleaned, cleaned
from urbantwin.reconstruct.cleaning.cloud import CleanedCloud, cleaned_cloud
from urbantwin.reconstruct.cleaning.decimate import unseen_error
from urbantwin.reconstruct.cleaning.removal import CleaningPicture, Removal

__all__ = [
    "Cleaned",
    "CleanedCloud",
    "CleaningPicture",
    "Removal",
    "cleaned",
    "cleaned_cloud",
    "unseen_error",
]
