"""Drag schemes by what they are, as their descriptors say."""

from discsim.parts import SCHEMES

ON_GRID = [name for name, scheme in SCHEMES.items() if scheme.on_grid]
POLAR = [name for name, scheme in SCHEMES.items() if scheme.polar]
OF_PARTICLES = [name for name in SCHEMES if name not in ON_GRID + POLAR]
NOT_CONSERVING = [name for name, scheme in SCHEMES.items() if not scheme.conserves]
INTERPOLATING = [name for name in OF_PARTICLES if name in NOT_CONSERVING]
BETWEEN_PAIRS = [name for name in OF_PARTICLES if SCHEMES[name].cells is None and name not in NOT_CONSERVING]
