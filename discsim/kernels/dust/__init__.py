"""Dust beyond drag: growth, diffusion, radiation pressure, dust in a prescribed gas."""
