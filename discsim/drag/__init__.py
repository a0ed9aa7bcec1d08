"""Drag schemes, one file each, with its `SCHEME` (`discsim/drag/base.py`), and the modules that several schemes
share. `published/` has schemes of other codes.
"""
