"""Drag schemes, one file each, with its `SCHEME` (`discsim/drag/base.py`), and the modules that several schemes
share.
"""
