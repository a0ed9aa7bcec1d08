"""What tests of the drag share."""

import numpy as np
import pytest

from discsim.effects import gas as gas_effect


@pytest.fixture
def prescribed(monkeypatch):
    """Gas of given density and sound speed, H/r = .05, with the pressure force of Sigma ~ 1/r, c_s^2 ~ 1/r about a
    star: -(1/Sigma) dP/dr = (p + q) c_s^2 / r, without SPH's noise.
    """

    def accelerate(self, view):
        gas, start = view.gas, self.scene.initial
        gas.density[:], gas.sound_speed[:] = 1.0, 1.0
        if self.scene.star is not None:
            r = np.sqrt((gas.pos**2).sum(axis=1))
            gas.density[:] = start.mass / (2 * np.pi * (start.outer - start.inner) * r)
            gas.sound_speed[:] = 0.05 / np.sqrt(r)
            acc = gas.acc_unshared
            acc += (2 * 0.05**2 / r**3)[:, None] * gas.pos
        gas.h[:] = self.scene.gas.eta * np.sqrt(gas.mass / gas.density)
        return np.inf

    monkeypatch.setattr(gas_effect.Effect, "accelerate", accelerate)
