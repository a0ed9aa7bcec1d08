"""Loops that several parts share: arrays, sorting, the grid, neighbour lists, exact sums, random numbers."""
