"""Images of a disc on the sky: dust continuum with beam and noise, velocities of the gas, FITS files."""
