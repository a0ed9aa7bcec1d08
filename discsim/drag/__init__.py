"""Drag schemes, and the modules that they share.

Each scheme is a file with an object `SCHEME`. `base.py` defines the interface, and `engine.py` calls the schemes.
`published/` has schemes of other codes.
"""
