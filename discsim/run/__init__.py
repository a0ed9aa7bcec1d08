"""Simulation of a scene with its step loop, and a run with its directory, progress and costs."""
