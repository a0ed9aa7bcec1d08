"""The tables of effects that a `Scene` has as attributes, one module per table."""
