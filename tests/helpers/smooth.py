"""The first snapshot of a smooth disc of gas and dust, and how its pictures are judged.

What a test measures is printed, with the version of the tool: `python -m pytest -m tools -n 0 -s`.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from discsim import load_scene, read_snapshot
from discsim.output.snapshot import Snapshot
from discsim.physics.profile import radial
from discsim.run.runner import run_scene

DISC = {
    "title": "A smooth disc for other tools",
    "run": {"until": "0.1 yr"},
    "space": {"size": "200 au"},
    "initial": {
        "kind": "disc", "mass": "0.01 Msun", "inner": "10 au", "outer": "80 au",
        "inner_taper": "8 au", "outer_taper": "20 au",
    },
    "star": {"mass": "1 Msun", "accretion_radius": "5 au"},
    "companion": [{"mass": "0.003 Msun", "semi_major_axis": "95 au", "softening": "2 au"}],
    "drag": {"law": "epstein", "direction": "two-way"},
    "gas": {
        "particles": 20_000, "kernel": "quintic",
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07, "reference_radius": "20 au"},
    },
    "dust": {"particles": 20_000, "ratio": 0.01, "grain_size": "3 mm", "grain_density": "2 g/cm3"},
}  # fmt: skip
HALF, PIXELS = 80.0, 500  # half the side of a picture in au
RADII = np.array([25.0, 32.0, 40.0, 47.0, 55.0])
RING = 1.0  # half its width in au
# What kernels of radius 5 au and rings of 2 au change of a Sigma of r^-1: (sigma / r)^2 / 2 < 0.3% at 25 au, where
# sigma is a third of the radius, and less beyond; the start's own noise is 0.1%.
SHARE = 0.005


class Smooth(NamedTuple):
    """A snapshot and its file. sigma: of gas at RADII, mass: of all gas, both in cgs; ratio: of dust to gas."""

    path: Path
    snap: Snapshot
    sigma: np.ndarray
    mass: float
    ratio: float

    def judge(self, tool, mass, image, half=HALF, share=SHARE):
        """A mass in g, and a picture [ix, iy] in g/cm2 from -half to half about the star, of the gas."""
        x = (np.arange(len(image)) + 0.5) / len(image) * 2.0 * half - half
        r = np.hypot(x[:, None], x)
        found = np.array([image[np.abs(r - ring) < RING].mean() for ring in RADII])
        print(f"{tool}: mass {mass / self.mass - 1.0:+.1e}, Sigma {np.round(100 * (found / self.sigma - 1.0), 2)} %")
        # swiftsimio rounds units to five digits.
        assert mass == pytest.approx(self.mass, rel=1e-5)
        np.testing.assert_allclose(found, self.sigma, rtol=share)


def smooth(folder):
    """Run the disc into a folder."""
    scene = load_scene(DISC)
    assert run_scene(scene, folder, quiet=True) == 0
    path = folder / "snapshots" / "0000.h5"
    cgs, sigma = scene.units.cgs, radial(scene).surface_density(RADII)
    return Smooth(path, read_snapshot(path), sigma * cgs("surface_density"), 0.01 * cgs("mass"), 0.01)
