"""Version of rehab_opt; the metadata of the wheel read it here."""

__all__ = ["__version__"]

__version__ = "0.1.0"
