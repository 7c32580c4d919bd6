"""Who goes where: the street network as a class of actors uses it, their circuits and flows."""
