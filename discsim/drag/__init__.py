"""Drag schemes, one a file: each says what its blocks do and gives `driver(dim, two_way)`, the kick of all blocks."""

# Name in the scene -> module.
SCHEMES = {"idic": "discsim.drag.idic", "idic-linear": "discsim.drag.idic_linear"}
