"""Drag schemes, one file each with its `SCHEME`, and the modules that they share. `base.py` is their interface, and
`engine.py` calls them. `published/` has schemes of other codes.
"""
