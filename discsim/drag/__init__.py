"""Drag schemes, one a file: each says what a cell does with the velocities in it, and whether the cells move."""

# Name in the scene -> module.
SCHEMES = {"idic": "discsim.drag.idic", "idic-linear": "discsim.drag.idic_linear"}
