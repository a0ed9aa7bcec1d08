"""Estimates for a scene before it runs: derived numbers, warnings, forecast, accuracy. Also the reference of keys."""
