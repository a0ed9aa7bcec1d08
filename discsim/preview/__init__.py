"""Estimates for a scene before it runs: derived numbers, warnings, forecast and accuracy; and the reference of keys."""
