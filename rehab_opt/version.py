"""The version, which the wheel's metadata are made from too."""

__all__ = ["__version__"]

__version__ = "0.1.0"
