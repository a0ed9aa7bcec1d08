"""Gas on a polar grid: scenes of discs, polar components, and gas without effects for tests of the kernels."""

import numpy as np

from discsim.numerics.polar import PolarCells

MASS = 1.3  # of the star


def disc_scene(inner, outer, cells, index=1.0, aspect=0.07):
    """The scene of a disc on a polar grid: Sigma = 1e-4 r^-index, uniform H/r = aspect, code units."""
    return {
        "units": {"system": "code"},
        "run": {"until": 4.0},
        "space": {"size": 5.0},
        "initial": {
            "kind": "disc", "surface_density": 1e-4, "inner": inner, "outer": outer, "surface_density_index": index,
        },
        "star": {"mass": MASS},
        "gas": {
            "method": "grid",
            "particles": cells,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0},
        },
    }  # fmt: skip


def polar(particles):
    """Radius, radial and azimuthal velocity (n,)."""
    r = np.hypot(*particles.pos.T)
    x, y = particles.pos.T / r
    return r, x * particles.vel[:, 0] + y * particles.vel[:, 1], x * particles.vel[:, 1] - y * particles.vel[:, 0]


def set_polar(particles, radial, around):
    """Set the velocities to these polar components (n,)."""
    r = np.hypot(*particles.pos.T)
    x, y = particles.pos.T / r
    particles.vel[:] = np.stack([x * radial - y * around, y * radial + x * around], axis=1)


class Disc:
    """Gas in `cells` with c_s(r) or u, about a point mass `star`, in a leapfrog; arrays as in the state of a run.

    share: mass of small dust over that of the cells.
    """

    def __init__(self, cells, density, radial, around, sound=None, u=None, gamma=1.0, star=1.0, share=None):
        self.cells, self.gamma, self.star, self.u = cells, gamma, star, u
        self.r, self.phi = np.hypot(*cells.pos.T), np.arctan2(cells.pos[:, 1], cells.pos[:, 0])
        self.mass = density * cells.area
        self.small = None if share is None else share * self.mass
        self.out = cells.pos / self.r[:, None]
        self.across = np.stack([-self.out[:, 1], self.out[:, 0]], axis=1)
        self.vel = np.asarray(radial)[..., None] * self.out + np.asarray(around)[..., None] * self.across
        self.sound = sound
        self.step_number, self.time = 0, 0.0
        self.acc, self.rate = np.zeros_like(self.vel), np.zeros(len(density))
        self.forces(0.0)

    @property
    def density(self):
        return self.mass / self.cells.area

    @property
    def v_r(self):
        return (self.vel * self.out).sum(axis=1)

    @property
    def v_phi(self):
        return (self.vel * self.across).sum(axis=1)

    def angular_momentum(self):
        return (self.mass * self.r * self.v_phi).sum()

    def forces(self, lag):
        rho = self.density
        u = None if self.u is None else self.u + lag * self.rate
        self.pressure = self.sound**2 * rho if u is None else (self.gamma - 1.0) * rho * u
        sound = np.sqrt(self.gamma * self.pressure / rho)
        self.cells.find_velocities(self.vel, self.acc, lag)
        acc = -self.star / self.r[:, None] ** 2 * self.out
        heat = None if u is None else np.empty_like(rho)
        stiff = 0.5 if u is None else 0.25 * (self.gamma + 1.0)
        self.limit = self.cells.accelerate(rho, self.pressure, sound, stiff, acc, heat)
        self.acc, self.rate = acc, heat if heat is not None else self.rate

    def kick(self, dt):
        self.vel += dt * self.acc
        if self.u is not None:
            self.u += dt * self.rate

    def step(self, dt):
        self.kick(0.5 * dt)
        radial_first = self.step_number % 2 == 0
        lost = self.cells.move(
            self.mass, self.vel, self.pressure, self.u, self.gamma, dt, radial_first=radial_first, small=self.small
        )
        self.step_number += 1
        self.time += dt
        self.forces(0.5 * dt)
        self.kick(0.5 * dt)
        return lost

    def run(self, until, courant=0.5):
        while self.time < until * (1.0 - 1e-12):
            self.step(min(courant * self.limit, until - self.time))


def ring(rings, angles, inner, outer, closed=True):
    return PolarCells(rings, angles, inner, outer, closed)


def rotating(cells, noise):
    """Adiabatic gas in rotation about a star, with noise of relative amplitude `noise`."""
    rng = np.random.default_rng(3)
    r = np.hypot(*cells.pos.T)
    some = noise * rng.standard_normal((4, len(r)))
    return Disc(cells, np.exp(some[0]), some[1] / 10, r**-0.5 + some[2] / 10, u=0.01 * np.exp(some[3]), gamma=1.4)
