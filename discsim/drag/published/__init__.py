"""Drag schemes of other codes, as published, for comparisons, and the modules that these schemes share."""
