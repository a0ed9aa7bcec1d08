"""Sums of smoothed particle hydrodynamics, and other loops over gas particles."""
