"""Loops that several packages of kernels share: arrays, sorting, grid, neighbour lists, exact sums, random numbers."""
