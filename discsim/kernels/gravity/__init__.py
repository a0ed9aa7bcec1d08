"""Point masses, Kepler orbits, and the Poisson solver on a grid."""
