"""Drag schemes, one a file, each with its `SCHEME` (`discsim/drag/base.py`), and what several of them share."""
