"""Drag schemes as published, for comparisons, and the modules that they share."""
