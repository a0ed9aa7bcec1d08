"""A scene as text, written with changes."""

DISC = """\
title = "a disc"
[units]
length = "1 au"               # line 3
mass = "1 Msun"
[run]
until = "1060 yr"
[space]
size = "260 au"
cells = 512
[initial]
kind = "disc"
mass = "0.1 Msun"
inner = "10 au"
outer = "100 au"
[gas]
particles = 100_000
[gas.eos]
kind = "locally-isothermal"
aspect_ratio = 0.05
reference_radius = "10 au"
[gas.viscosity]               # artificial
[dust]
particles = 200_000
ratio = 0.01
grain_size = "1 cm"
grain_density = "3 g/cm3"
[star]
mass = "1 Msun"
[self_gravity]
softening = "1 au"
[drag]
law = "epstein"
"""


def write(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path
