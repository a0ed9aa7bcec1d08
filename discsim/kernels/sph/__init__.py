"""Sums of smoothed particle hydrodynamics, and what else changes gas."""
