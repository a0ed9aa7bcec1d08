"""Drag between nodes of a lattice (scheme `tsc`)."""
