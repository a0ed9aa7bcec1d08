"""Decomposition of space over MPI ranks: tiles, halos."""
