"""The card of a dataset: what it is, how it was made, what may be done with it, what it is not."""
