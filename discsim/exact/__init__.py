"""Exact solutions of test problems, as functions of numbers and arrays."""
