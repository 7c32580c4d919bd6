"""The card of a dataset: what it is, how it was made, what may be done with it, what it is not."""

from urbantwin.dataset.card.page import (
    CARD,
    PICTURES,
    card_of_dataset,
    card_of_folder,
    dataset_folders,
)

__all__ = ["CARD", "PICTURES", "card_of_dataset", "card_of_folder", "dataset_folders"]
