"""Exact solutions and theory, as functions of numbers and arrays alone."""
