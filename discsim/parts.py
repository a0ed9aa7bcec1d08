"""Registries of the exchangeable parts of discsim: equations of state, drag laws and schemes, starts, effects, fields.

Each registry maps the names that scenes use to Python objects, and imports an object when its name is looked up.
Other packages add parts as entry points in the groups below; the name of the entry point is the name in scenes.

    [project.entry-points."discsim.schemes"]
    my-scheme = "my_package.my_scheme:SCHEME"
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from discsim.printable import UserError


class PartError(UserError):
    """A part of another package that cannot be used; the message has the name and the reason."""


@cache
def package_entry_points() -> Any:
    """Return the entry points of all installed packages, from a single search."""
    return entry_points()


class Parts(Mapping[str, Any]):
    """Registry of the parts of one kind by name; parts of other packages come last.

    group: name of the entry points of other packages. homes: where each part is, as "module:object". has: attributes
    that every part must have.
    Looking up a name imports the module; iteration and `in` import nothing. Raises PartError if a part of another
    package cannot be imported or lacks an attribute.
    """

    def __init__(self, group: str, homes: Mapping[str, str], has: Sequence[str] = ()) -> None:
        self.group, self._own, self._has = group, dict(homes), has

    @cached_property
    def homes(self) -> dict[str, str]:
        """The location "module:object" of each part by name. Raises PartError if two parts have the same name."""
        found = dict(self._own)
        for point in package_entry_points().select(group=self.group):
            if found.get(point.name, point.value) != point.value:
                raise PartError(
                    f'{self.group}: "{point.name}" is {found[point.name]}, and also {point.value} of another package; '
                    "expected different names, or that package uninstalled"
                )
            found[point.name] = point.value
        return found

    def module(self, name: str) -> str:
        """Return the name of the module that contains the part `name`."""
        return self.homes[name].partition(":")[0]

    def __getitem__(self, name: str) -> Any:
        home = self.homes[name]
        try:
            found = import_object(home)
        except Exception as error:  # another package may raise anything
            if name in self._own:
                raise
            wrong = f"{type(error).__name__}: {error}"
            raise PartError(
                f'{self.group}: "{name}" of another package cannot be imported from {home}: {wrong}; '
                "expected that package repaired or uninstalled"
            ) from error
        if lacks := [attribute for attribute in self._has if not hasattr(found, attribute)]:
            raise PartError(
                f'{self.group}: "{name}" of another package, {home}, has no {lacks[0]}; '
                "expected an object as in the recipes, or that package uninstalled"
            )
        return found

    def __contains__(self, name: object) -> bool:
        return name in self.homes  # Mapping.__contains__ would import the part

    def __iter__(self) -> Iterator[str]:
        return iter(self.homes)

    def __len__(self) -> int:
        return len(self.homes)


def import_object(home: str) -> Any:
    """Import the module of "module:object", and return the object."""
    module, _, attribute = home.partition(":")
    return getattr(import_module(module), attribute)


class Lazy:
    """Proxy of a module, which is imported at the first access to one of its attributes.

        kernels = Lazy("discsim.kernels.move")

    numba and compiled kernels are slow to import, and commands that only read a scene do not need them.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    @cached_property
    def _module(self) -> Any:
        return import_module(self._name)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # copying and pickling look these up
            raise AttributeError(name)
        return getattr(self._module, name)

    def __reduce__(self) -> tuple[type[Lazy], tuple[str]]:
        return Lazy, (self._name,)


def install_command(extra: str) -> str:
    """Return the command that installs the optional dependencies `extra` (docs/install.md), for messages."""
    return f"pip install -e '.[{extra}]' in a clone of discsim"


# Equations of state: values of `gas.eos.kind`.
EOS = Parts(
    "discsim.eos",
    {
        "isothermal": "discsim.physics.eos:ISOTHERMAL",
        "locally-isothermal": "discsim.physics.eos:LOCALLY_ISOTHERMAL",
        "adiabatic": "discsim.physics.eos:ADIABATIC",
        "polytropic": "discsim.physics.eos:POLYTROPIC",
    },
    has=("keys", "rules", "pressure_and_sound_speed"),
)

# Laws of the stopping time: values of `drag.law`.
LAWS = Parts(
    "discsim.laws",
    {
        "epstein": "discsim.physics.laws:EPSTEIN",
        "epstein-stokes": "discsim.physics.laws:EPSTEIN_STOKES",
        "constant": "discsim.physics.laws:CONSTANT",
        "stopping-time": "discsim.physics.laws:STOPPING_TIME",
        "stokes-number": "discsim.physics.laws:STOKES_NUMBER",
        "stokes-over-density": "discsim.physics.laws:STOKES_OVER_DENSITY",
    },
    has=("form", "value", "rules"),
)

# Drag schemes: values of `drag.scheme`.
SCHEMES = Parts(
    "discsim.schemes",
    {
        "idic": "discsim.drag.idic:SCHEME",
        "idic-linear": "discsim.drag.idic_linear:SCHEME",
        "tsc": "discsim.drag.tsc:SCHEME",
        "mk": "discsim.drag.published.mk:SCHEME",
        "lab14": "discsim.drag.published.lab14:SCHEME",
        "reconstructed": "discsim.drag.published.reconstructed:SCHEME",
        "esph": "discsim.drag.published.esph:SCHEME",
        "isph": "discsim.drag.published.isph:SCHEME",
        "sios-ppm": "discsim.drag.published.sios_ppm:SCHEME",
        "emsi-ppm": "discsim.drag.published.emsi_ppm:SCHEME",
    },
    has=("kick", "advance", "cells"),
)
USUAL_SCHEME = "tsc"  # the default, which warnings about other schemes recommend

# Initial conditions: values of `initial.kind`.
STARTS = Parts(
    "discsim.starts",
    {
        "disc": "discsim.initial.disc:START",
        "table": "discsim.initial.table:START",
        "snapshot": "discsim.output.restart:START",
        "viscous-ring": "discsim.initial.viscous_ring:START",
        "steady": "discsim.initial.steady:START",
        "box": "discsim.initial.box:START",
        "wave": "discsim.initial.wave:START",
        "shock": "discsim.initial.shock:START",
        "sheet": "discsim.initial.sheet:START",
        "blast": "discsim.initial.blast:START",
        "settling": "discsim.initial.settling:START",
        "vortex": "discsim.initial.vortex:START",
    },
    has=("keys", "particles", "rules"),
)

# Effects by the name of their table in a scene, in the order in which a step calls them.
EFFECTS = Parts(
    "discsim.effects",
    {
        "gas": "discsim.effects.gas:Effect",
        "alpha_viscosity": "discsim.effects.alpha_viscosity:Effect",
        "background": "discsim.effects.given_disc:Background",
        "dust": "discsim.effects.dust:Effect",
        "star": "discsim.effects.star:Effect",
        "companion": "discsim.effects.companion:Effect",
        "self_gravity": "discsim.effects.self_gravity:Effect",
        "radiation_pressure": "discsim.effects.radiation_pressure:Effect",
        "external": "discsim.effects.external:Effect",
        "cooling": "discsim.effects.cooling:Effect",
        "drag": "discsim.effects.drag:Effect",
        "dust_diffusion": "discsim.effects.dust_diffusion:Effect",
        "damping": "discsim.effects.damping:Effect",
        "growth": "discsim.effects.growth:Effect",
    },
    has=("keys", "rules", "begin"),
)

# Fields of snapshots: names for `discsim plot --field` and `snap.field`.
FIELDS = Parts(
    "discsim.fields",
    {
        "gas.surface_density": "discsim.output.fields.gas:surface_density",
        "gas.density": "discsim.output.fields.gas:density",
        "gas.temperature": "discsim.output.fields.gas:temperature",
        "gas.pressure": "discsim.output.fields.gas:pressure",
        "gas.sound_speed": "discsim.output.fields.gas:sound_speed",
        "gas.aspect_ratio": "discsim.output.fields.gas:aspect_ratio",
        "gas.toomre_q": "discsim.output.fields.gas:toomre_q",
        "gas.h": "discsim.output.fields.gas:h",
        "gas.v_r": "discsim.output.fields.motion:gas_v_r",
        "gas.v_phi": "discsim.output.fields.motion:gas_v_phi",
        "gas.v_phi_excess": "discsim.output.fields.motion:gas_v_phi_excess",
        "gas.v_x": "discsim.output.fields.motion:gas_v_x",
        "gas.v_y": "discsim.output.fields.motion:gas_v_y",
        "gas.eccentricity": "discsim.output.fields.motion:gas_eccentricity",
        "gas.radius": "discsim.output.fields.motion:gas_radius",
        "gas.x": "discsim.output.fields.motion:gas_x",
        "gas.y": "discsim.output.fields.motion:gas_y",
        "dust.surface_density": "discsim.output.fields.dust:surface_density",
        "dust.stokes": "discsim.output.fields.dust:stokes",
        "dust.stopping_time": "discsim.output.fields.dust:stopping_time",
        "dust.size": "discsim.output.fields.dust:size",
        "dust.v_r": "discsim.output.fields.motion:dust_v_r",
        "dust.v_phi": "discsim.output.fields.motion:dust_v_phi",
        "dust.v_phi_excess": "discsim.output.fields.motion:dust_v_phi_excess",
        "dust.v_x": "discsim.output.fields.motion:dust_v_x",
        "dust.v_y": "discsim.output.fields.motion:dust_v_y",
        "dust.eccentricity": "discsim.output.fields.motion:dust_eccentricity",
        "dust.radius": "discsim.output.fields.motion:dust_radius",
        "dust.x": "discsim.output.fields.motion:dust_x",
        "dust.y": "discsim.output.fields.motion:dust_y",
        "small_dust.surface_density": "discsim.output.fields.dust:small_surface_density",
        "dust_to_gas": "discsim.output.fields.combined:dust_to_gas",
        "optical_depth": "discsim.output.fields.combined:optical_depth",
        "emission": "discsim.output.fields.combined:emission",
    },
    has=("kind", "species", "values"),
)

# Gas models; a scene uses the first one that fits. Other packages cannot add gas models or integrators.
MODELS = (
    "discsim.effects.models:GIVEN_DISC",
    "discsim.effects.models:FIXED_CELLS",
    "discsim.effects.models:SPH",
)

# Integrators: values of `run.integrator`.
INTEGRATORS = {
    "kdk": "discsim.run.integrators:kdk",
    "euler": "discsim.run.integrators:euler",
}
