"""The version of discsim, for files and messages; `pyproject.toml` reads it from here."""

__version__ = "0.1.0"
