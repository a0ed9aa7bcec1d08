"""Implicit drag: cells, pairs, laws of the stopping time, exact relaxation."""
