"""Numerical methods: particles, threads, neighbours, grids, Poisson solver, SPH sums. No rules of scenes are here."""
