"""Gas and dust as fluids on a fixed 1D grid."""
