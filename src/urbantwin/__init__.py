"""UrbanTwin: a real street intersection as a LiDAR digital twin and as labelled training data."""

__version__ = "0.1.0"

__all__ = ["__version__"]
