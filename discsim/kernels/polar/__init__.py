"""Kernels of gas in polar cells (`numerics/polar.py`)."""
