"""The version, which the metadata of the wheel use, too."""

__all__ = ["__version__"]

__version__ = "0.1.0"
