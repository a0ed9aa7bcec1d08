"""Gas in cells of a polar grid (`gas.method = "grid"`): finite volumes in rings that are even in ln r.

Pressure forces are in `kernels/polar/forces.py`, the motion of the gas through the sides of cells in `transport.py`,
viscous stress in `viscosity.py`. Each cell takes the place of a gas particle, at its centroid. The kick changes the
velocities of the cells, as those of particles, by all forces and drag; it contains the pull of the star. The drift
moves mass, momentum and energy between the cells. Gas and dust both drift in polar coordinates, so that circular orbits
are exact at any step. The star accretes gas that leaves an open inner edge.

The step limit is the shortest of 1 / (c_s |(1/dr, 1/(r dphi))| + |v_r| / dr + 2 |v_phi - mean| / (r dphi)); with the
mean rotation of a ring the step is not limited. Gas that leaves an open edge is counted with the accreted gas.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.published.fixed_grid import OF_SPH
from discsim.effects import alpha_viscosity, base, dust, gas
from discsim.effects.accretion import Accreted, add_to_body
from discsim.formulas.polar import MIN_ANGLES, MIN_RINGS, ring_count
from discsim.numerics import world
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import EOS, SCHEMES, Lazy
from discsim.physics import profile, viscosity
from discsim.physics.local import longest_step
from discsim.physics.polar import polar_shape
from discsim.scene.rules import Draft, Problem, quoted, starts_where

if TYPE_CHECKING:
    from discsim.effects.gas import Profile
    from discsim.scene import Scene

polar = Lazy("discsim.numerics.polar")
motion = Lazy("discsim.kernels.polar.dust")
growth = Lazy("discsim.physics.growth")

CELL_COST, HEAT_COST, VISCOUS_COST = 180.0, 120.0, 60.0  # CPU nanoseconds in a step, per cell
UNSTABLE = 1.5  # step of growing sound waves, over the step limit
MAX_PUSH = 0.5  # largest pressure force over gravity in the initial balance, as at sharp edges
LEAST_CELLS = MIN_RINGS * MIN_ANGLES  # smallest number of cells
THINNEST = 1e-6  # smallest (outer - inner) / inner of a grid
ELONGATED = 3.0  # smallest ratio of the sides of cells for a warning


# Rules


def grid_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of gas.method = "grid", and of a table gas.grid without it."""
    if draft.gas.method != "grid":
        if draft.gas.grid is not None:
            yield ("gas", "grid"), 'the table is used only with gas.method = "grid"; add this key, or remove gas.grid'
        return
    yield from _key_problems(draft)
    yield from _disc_problems(draft)
    yield from _star_problems(draft)
    yield from _effect_problems(draft)


def _key_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of keys of [gas] that a polar grid does not use, and of its edges."""
    for key in OF_SPH:
        if draft.gives("gas", key):
            yield ("gas", key), 'used only by SPH, but gas.method is "grid"; remove this key'
    grid = draft.gas.grid
    inner, outer = (None, None) if grid is None else (grid.inner, grid.outer)
    if None in (inner, outer):
        if draft.start is None:
            yield ("gas", "grid"), "without [initial] the grid has no edges; add gas.grid.inner and gas.grid.outer"
        elif draft.start.restore is not None and not draft.initial.file.polar:
            wrong = "initial.file has SPH particles and no edges"
            yield ("gas", "grid"), f"{wrong}; add gas.grid.inner and gas.grid.outer"
    yield from _edge_problems(draft, inner, outer)
    if grid is not None and grid.rings is not None and MIN_ANGLES * grid.rings > max(draft.gas.particles, LEAST_CELLS):
        wrong = f"{grid.rings} rings have at least {MIN_ANGLES * grid.rings} cells, more than gas.particles"
        yield ("gas", "grid", "rings"), f"{wrong}; expected at most gas.particles / {MIN_ANGLES}, or remove this key"
    if draft.space and outer is not None and 2.0 * outer > min(draft.space.size):
        yield ("space", "size"), "the space is smaller than the polar grid; expected at least 2 gas.grid.outer"


def _edge_problems(draft: Draft, inner: float | None, outer: float | None) -> Iterator[Problem]:
    """Yield problems of the edges of a polar grid, of which `inner` or `outer` may be that of the initial disc."""
    ends = tuple(getattr(draft.initial, name, None) for name in ("inner", "outer"))
    key = "inner" if outer is None else "outer"
    low, high = (ends[k] if given is None else given for k, given in enumerate((inner, outer)))
    if None not in (low, high) and high <= low * (1.0 + THINNEST):
        if inner is not None or outer is not None:
            wrong = "the outer edge is not larger than the inner one"
            yield (
                ("gas", "grid", key),
                f"{wrong}; expected gas.grid.inner < gas.grid.outer, by default those of [initial]",
            )
    elif None not in ends and ((outer or ends[1]) <= ends[0] or (inner or ends[0]) >= ends[1]):
        wrong = "the grid and the disc of [initial] have no radius in common"
        yield (
            ("gas", "grid", key),
            f"{wrong}; expected gas.grid.inner < initial.outer and gas.grid.outer > initial.inner",
        )


def _disc_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a space or a start without a disc, and of an integrator other than kdk."""
    if draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        wrong = "a polar grid needs an open plane"
        yield ("gas", "method"), f'{wrong}; set space.dimensions = 2 and space.boundary = "open", or method = "sph"'
    elif draft.start and draft.start.edges is None:
        words = quoted(starts_where(lambda start: start.edges is not None))
        wrong = f'a polar grid needs a disc, but initial.kind is "{draft.kind}"'
        yield ("gas", "method"), f'{wrong}; choose initial.kind {words}, or set method = "sph"'
    if getattr(draft.initial, "relax", 0.0) > 0.0:
        wrong = "gas on a polar grid starts in balance and needs no relaxation"
        yield ("initial", "relax"), f"{wrong}; remove this key"
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), 'the integrator does not support gas.method = "grid"; set run.integrator = "kdk"'


def _star_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a star that moves, or that accretes cells."""
    star = draft.star
    if star is not None:
        if star.frame != "star":
            wrong = "the polar grid is centred on the star"
            yield ("star", "frame"), f'{wrong}; set star.frame = "star", or gas.method = "sph"'
        inner = _inner_edge(draft)
        if inner is not None and star.accretion_radius > inner:
            wrong = "the star would accrete cells of the polar grid"
            yield ("star", "accretion_radius"), f"{wrong}; expected at most the inner edge of the grid"


def leaves_inwards(draft: Draft) -> bool:
    """Return whether gas leaves a polar grid of the draft through its inner edge."""
    grid = None if draft.gas is None else draft.gas.grid
    return draft.gas is not None and draft.gas.method == "grid" and (grid is None or grid.edges == "open")


def _inner_edge(draft: Draft) -> float | None:
    """Return the inner edge of the grid of a draft, as far as the tables give it."""
    if draft.gas.grid is not None and draft.gas.grid.inner is not None:
        return draft.gas.grid.inner
    return getattr(draft.initial, "inner", None)


def _effect_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of effects that need gas particles."""
    if draft.has("shearing_box"):
        yield ("shearing_box",), 'a shearing box has no polar grid; set gas.method = "sph"'
    if draft.drag and not _takes_cells(draft.drag.scheme):
        words = quoted(name for name in SCHEMES if _takes_cells(name))
        wrong = f'drag.scheme "{draft.drag.scheme}" needs pairs of particles, but gas.method is "grid"'
        yield ("drag", "scheme"), f"{wrong}; choose drag.scheme {words}"


def _takes_cells(scheme: str) -> bool:
    """Return whether the gas of a drag scheme may be in polar cells."""
    return SCHEMES[scheme].polar or SCHEMES[scheme].cells is not None


# Effects


class Gas(gas.Effect):
    """Pressure and motion of the gas in polar cells. cells: the cells."""

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene, self.quiet = scene, None
        self._fallen = np.zeros(5)  # what left the inner edge in the last drift, as `PolarCells.move` returns it
        self.cells = polar.PolarCells(*polar_shape(scene))
        eos = scene.gas.eos
        # s of the pressure at the sides: (gamma + 1) / 4, or 1/2 for isothermal gas.
        self.gamma = float(getattr(eos, "gamma", 1.0))
        self.stiff = 0.25 * (self.gamma + 1.0)
        if _has_cells(state):
            self._place(state)

    def _place(self, state: State) -> None:
        """Put the cells at their centroids, and set their smoothing lengths. Raises ValueError for other particles."""
        scene, particles, pos = self.scene, state.gas, self.cells.pos
        if particles.pos.shape != pos.shape:
            wrong = f"the gas has {particles.count} cells, but the polar grid has {len(pos)}"
            raise ValueError(f"{wrong}; take positions from discsim.numerics.polar.PolarCells")
        if np.abs(particles.pos - pos).max() > 1e-9 * self.cells.geometry.sides[-1]:
            raise ValueError("the gas is not at the centroids of the cells of gas.grid, in rings from the inside")
        if particles.immobile is not None:
            raise ValueError("immobile gas is not possible on a polar grid; remove the array immobile of the gas")
        if scene.star is not None and scene.star.accretion_radius > self.cells.geometry.sides[0]:
            inner = scene.units.show(self.cells.geometry.sides[0], "length")
            raise ValueError(f"star.accretion_radius is above {inner}, the inner edge of the polar grid; lower it")
        particles.pos[:] = pos
        particles.h[:] = scene.gas.eta * np.sqrt(self.cells.area)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return OF_SPH

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        shape = polar_shape(scene)
        ends = (scene.units.show(r, "length") for r in (shape.inner, shape.outer))
        rows = [("polar grid", f"{shape.rings} rings of {shape.angles} cells, from {' to '.join(ends)}")]
        if at.radius is not None and at.scale_height is not None:
            rows.append(("cells in H", ", ".join(f"{n:.3g}" for n in at.scale_height / shape.side(at.radius))))
        return base.Report(rows, chain(_resolution_warnings(scene, at), gas.timestep_warnings(scene, at)))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        more = HEAT_COST if EOS[scene.gas.eos.kind].holds_heat else 0.0
        return counts.gas * (CELL_COST + more)

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        at = outlook.at
        if at.h is None or at.sound_speed is None:
            return base.Expected()
        return at.smallest(longest_step(scene, at.h, at.sound_speed))

    def pressure_push(self, state: State, gravity: Profile) -> Profile | None:
        """Return the initial outward acceleration of gas by the pressure force of the cells, as a function of radii.

        The function is exact at the centroids of rings, and in between follows the initial profile. gravity: inward
        acceleration by gravity, as a function of radii. None without cells.
        """
        scene, r = self.scene, self.cells.geometry.radius
        if not _has_cells(state):
            return None
        disc = profile.radial(scene)
        with_small = state.gas.small is not None and growth.gas_mass_includes_small_dust(scene)
        # Small dust is accelerated together with the gas.
        total = 1.0 + growth.small_ratio_at(scene, r, disc.dust_share) if with_small else 1.0

        def given(r: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                push = disc.pressure_acceleration(r)
            return np.where((r > disc.inner) & (r < disc.outer) & np.isfinite(push), push, 0.0)

        more = total * self._mean_pressure_push(state, gravity(r)) - given(r)
        return lambda at: given(at) + np.interp(at, r, more)

    def _mean_pressure_push(self, state: State, pull: np.ndarray) -> np.ndarray:
        """Return the mean outward acceleration (rings,) by pressure, at most MAX_PUSH times `pull`.

        The gas is on circular orbits, as the pressure at jumps depends on the rotation in cells wider than H.
        """
        p, cells, radius = state.gas, self.cells, self.cells.geometry.radius
        vel, acc = p.vel, np.zeros_like(p.vel)
        omega = np.sqrt(np.maximum(pull, 0.0) / radius)
        p.vel = np.repeat(omega, cells.angles)[:, None] * cells.pos[:, ::-1] * [-1.0, 1.0]
        self._add_pressure(state, acc)
        p.vel = vel
        push = (acc * cells.pos).sum(axis=1).reshape(cells.shape).mean(axis=1) / radius
        return np.clip(push, -MAX_PUSH * np.abs(pull), MAX_PUSH * np.abs(pull))

    def operators(self, state: State) -> list[base.Operator]:
        slots = base.Slot
        reads = base.arrays("gas", "pos mass vel kick_acc u kick_rate small") | {"bodies"}
        made = "acc_unshared pressure sound_speed nu heating_rate pressure_acc pressure_vel last_heating_rate "
        made += "last_pressure_acc"
        found = base.arrays("gas", "density")
        return [
            base.Operator(gas.DENSITY, slots.FIELD, self.find_density, reads, found),
            base.Operator("gas.forces", slots.FORCE, self.accelerate, reads | found | {gas.DENSITY},
                          base.arrays("gas", made)),
            base.Operator("gas.limit", slots.LIMIT, self.limit, frozenset({"gas.forces"})),
            base.Operator("gas.kick", slots.KICK, gas.kick_gas),
            base.Operator("gas.drift", slots.DRIFT, self.drift),
            base.Operator("gas.event", slots.EVENT, self.event),
        ]  # fmt: skip

    def find_density(self, view: base.View | State) -> None:
        """Set the surface density of the gas."""
        self.cells.surface_density(view.gas.mass, view.gas.density)

    def accelerate(self, view: base.View) -> float:
        """Add the accelerations by pressure and viscosity to `acc_unshared`, and return the step limit."""
        p = view.gas
        if p.pressure_acc is None:
            return self._add_pressure(view, p.acc_unshared)
        p.last_pressure_acc[:], p.pressure_acc[:] = p.pressure_acc, 0.0
        limit = self._add_pressure(view, p.pressure_acc)
        p.acc_unshared += p.pressure_acc
        return limit

    def _add_pressure(self, view: base.View | State, acc: np.ndarray) -> float:
        """Add the accelerations by pressure and viscosity to `acc` (n, 2), and return the step limit.

        Energy and velocity at the time of the positions are first extrapolated with the rates of the last kick, and
        then with the present rates by pressure. With the first alone, short sound waves grow in steps near the limit.
        """
        p, lag = view.gas, view.velocity_lag
        if isinstance(view, State):
            self.find_density(view)
        self.cells.find_velocities(p.vel, p.kick_acc, lag)
        if p.u is None:
            return self._add_forces(view, None, acc)
        p.last_heating_rate[:] = p.heating_rate
        u, rate = gas.energy_after(view, lag), p.kick_acc
        if lag > 0.0:
            rate = np.zeros_like(acc)
            self._add_forces(view, u, rate)
            u += lag * (p.heating_rate - p.last_heating_rate)
            np.maximum(u, self.scene.model.least_energy * p.u, out=u)
            rate += p.kick_acc
            rate -= p.last_pressure_acc
            self.cells.find_velocities(p.vel, rate, lag)
        if p.pressure_vel is not None:
            p.pressure_vel[:] = p.vel + lag * rate
        return self._add_forces(view, u, acc)

    def _add_forces(self, view: base.View | State, u: np.ndarray | None, acc: np.ndarray) -> float:
        """Set pressure, viscosity and heating rate, add accelerations to `acc` (n, 2), and return the step limit.

        u (n,): specific energy; None for gas without an energy equation. Velocities are those of the last
        `cells.find_velocities`.
        """
        p, cells = view.gas, self.cells
        self.set_pressure(view, u)
        limit = cells.accelerate(p.density, p.pressure, p.sound_speed, self.stiff, acc, p.heating_rate)
        if p.nu is not None:
            self.find_viscosity(view)
            cells.add_viscosity(p.density, p.nu, acc, p.heating_rate)
        return limit

    def viscous_acceleration(self, state: State) -> np.ndarray:
        p, cells = state.gas, self.cells
        acc, unused = np.zeros_like(p.acc), np.zeros_like(p.acc)
        density = cells.surface_density(p.mass, np.empty_like(p.mass))
        cells.find_velocities(p.vel, p.kick_acc, state.velocity_lag)
        cells.accelerate(density, p.pressure, p.sound_speed, self.stiff, unused, None)
        if p.nu is not None:
            cells.add_viscosity(density, p.nu, acc, None)
        return acc

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        step = view["gas.forces"]
        return {"gas": base.Limit(step, UNSTABLE * step, remedy="fewer gas.particles")}

    def drift(self, state: State, dt: float) -> None:
        """Move the gas between the cells, and record what leaves the edges in the ledger."""
        p, ledger = state.gas, state.ledger
        radial_first = (state.step + state.earlier) % 2 == 0
        before = None if p.radiated is None else p.mass.copy()
        edges = self.cells.move(p.mass, p.vel, p.pressure, p.u, self.gamma, dt, radial_first, p.small)
        if before is not None:
            p.radiated *= before / p.mass  # radiated energy is that of a place
        edges = world.processes.sum(edges)  # an edge belongs to one process, and the others add 0
        lost = edges.sum(axis=0)
        if lost.any():
            ledger.accreted_gas += float(lost[0])
            ledger.accreted_momentum += lost[1:3]
            ledger.accreted_angular_momentum += float(lost[3])
        if p.small is not None and lost[4] != 0.0:
            ledger.accreted_small += float(lost[4])
            if growth.gas_mass_includes_small_dust(self.scene):
                ledger.accreted_gas -= float(lost[4])
        self._fallen = edges[0]

    def event(self, state: State) -> None:
        """Let the star accrete the gas that left the inner edge in the step."""
        mass, small = float(self._fallen[0]), float(self._fallen[4])
        if mass == 0.0 or state.bodies is None or self.scene.star is None:
            return
        included = small if state.gas.small is not None and growth.gas_mass_includes_small_dust(self.scene) else 0.0
        # The star stays at the origin of its frame.
        add_to_body(state, 0, "gas", (), Accreted(mass, mass - included, small), self.scene.star.grows, moves=False)


def _has_cells(state: State) -> bool:
    """Return whether the gas is that of the scene, and not zeros, as at the start of a process without particles."""
    return bool(state.gas.mass.any())


def _resolution_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield warnings of cells that are not smaller than the scale height, and of long cells."""
    shape = polar_shape(scene)
    longer = max(shape.elongation, 1.0 / shape.elongation)
    if longer > ELONGATED:
        square = ring_count(scene.gas.particles, shape.inner, shape.outer)
        which = "azimuth" if shape.elongation > 1.0 else "radius"
        yield f"cells are {longer:.3g} times longer in {which}: remove gas.grid.rings, for {square} rings"
    if at.radius is None or at.scale_height is None:
        return
    ratios = shape.side(at.radius) / at.scale_height
    worst = int(np.argmax(ratios))
    ratio = float(ratios[worst])
    if ratio > 1.0:
        needed = shape.cells * ratio**2
        yield f"cells are {ratio:.2g} H wide {at.where(worst)}: raise gas.particles to about {needed:.2g}"


class Dust(dust.Effect):
    """Dust that drifts in polar coordinates, as the gas (`kernels/polar/dust.py`)."""

    def drift(self, state: State, dt: float) -> None:
        p = state.dust
        if p.immobile is None:
            parallel_for(motion.drift, p.count, p.pos, p.vel, dt)
            return
        free = ~p.immobile
        pos, vel = p.pos[free], p.vel[free]
        parallel_for(motion.drift, len(pos), pos, vel, dt)
        p.pos[free], p.vel[free] = pos, vel


class Viscosity(alpha_viscosity.Effect):
    """Time-step limit of a shear viscosity in polar cells: square of the shorter side over 4 nu."""

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(alpha_viscosity.requested_rows(scene, at))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return VISCOUS_COST * counts.gas

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        p = view.gas
        if p.count == 0:
            return {}
        step = float(viscosity.longest_step(view.scene, p.nu, p.h).min())
        return {"gas": base.Limit(step, UNSTABLE * step)}
