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
    """Error for a part of another package that cannot be used; the message has its name and the reason."""


@cache
def package_entry_points() -> Any:
    """Return the entry points of all installed packages, which are searched once."""
    return entry_points()


class Registry(Mapping[str, Any]):
    """Mapping from names to the parts of one kind; parts of other packages come last.

    group: group of the entry points by which other packages add parts. locations: location of each part of discsim, as
    "module:object". required: attributes that every part must have. added: parts that `add` has added, by name.
    Looking up a name imports the module; iteration and `in` import nothing. Raises PartError if a part of another
    package cannot be imported or lacks a required attribute.
    """

    def __init__(self, group: str, locations: Mapping[str, str], required: Sequence[str] = ()) -> None:
        self.group, self._own, self._required = group, dict(locations), required
        self.added: dict[str, Any] = {}

    @cached_property
    def locations(self) -> dict[str, str]:
        """The location "module:object" of each part by name. Raises PartError if two parts have the same name."""
        found = dict(self._own)
        for point in package_entry_points().select(group=self.group):
            if found.get(point.name, point.value) != point.value:
                raise PartError(
                    f'{self.group}: the name "{point.name}" belongs to {found[point.name]}, and to '
                    f"{point.value} of another package; "
                    f"rename {point.value}, or uninstall its package"
                )
            found[point.name] = point.value
        return found | {name: f"{part.__module__}:{part.__qualname__}" for name, part in self.added.items()}

    def add(self, name: str, part: Any) -> None:
        """Add a part, until this process ends; the caller has checked that its name is free."""
        self.added[name] = part
        self.__dict__.pop("locations", None)

    def module(self, name: str) -> str:
        """Return the name of the module that contains the part `name`."""
        return self.locations[name].partition(":")[0]

    def __getitem__(self, name: str) -> Any:
        if name in self.added:
            return self.added[name]
        location = self.locations[name]
        try:
            found = import_object(location)
        except Exception as error:  # another package may raise anything
            if name in self._own:
                raise
            wrong = f"{type(error).__name__}: {error}"
            raise PartError(
                f'{self.group}: "{name}" of another package cannot be imported from {location}: {wrong}; '
                "repair or uninstall the package"
            ) from error
        if missing := [attribute for attribute in self._required if not hasattr(found, attribute)]:
            raise PartError(
                f'{self.group}: "{name}" of another package, {location}, has no {missing[0]}; '
                "repair the package as in docs/recipes, or uninstall the package"
            )
        return found

    def __contains__(self, name: object) -> bool:
        return name in self.locations  # Mapping.__contains__ would import the part

    def __iter__(self) -> Iterator[str]:
        return iter(self.locations)

    def __len__(self) -> int:
        return len(self.locations)


def import_object(location: str) -> Any:
    """Import the module of the location "module:object", and return the object."""
    module, _, attribute = location.partition(":")
    return getattr(import_module(module), attribute)


class Lazy:
    """Proxy of the module `name`, which is imported at the first access to one of its attributes.

        moves = Lazy("discsim.kernels.common.move")

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
EOS = Registry(
    "discsim.eos",
    {
        "isothermal": "discsim.physics.eos:ISOTHERMAL",
        "locally-isothermal": "discsim.physics.eos:LOCALLY_ISOTHERMAL",
        "adiabatic": "discsim.physics.eos:ADIABATIC",
        "polytropic": "discsim.physics.eos:POLYTROPIC",
    },
    required=("keys", "rules", "pressure_and_sound_speed"),
)

# Laws of the stopping time: values of `drag.law`.
LAWS = Registry(
    "discsim.laws",
    {
        "epstein": "discsim.physics.laws:EPSTEIN",
        "epstein-stokes": "discsim.physics.laws:EPSTEIN_STOKES",
        "constant": "discsim.physics.laws:CONSTANT",
        "stopping-time": "discsim.physics.laws:STOPPING_TIME",
        "stokes-number": "discsim.physics.laws:STOKES_NUMBER",
        "stokes-over-density": "discsim.physics.laws:STOKES_OVER_DENSITY",
    },
    required=("form", "value", "rules"),
)

# Drag schemes: values of `drag.scheme`.
SCHEMES = Registry(
    "discsim.schemes",
    {
        "idic": "discsim.drag.idic:SCHEME",
        "idic-linear": "discsim.drag.idic_linear:SCHEME",
        "tsc": "discsim.drag.tsc:SCHEME",
        "emsi": "discsim.drag.emsi:SCHEME",
        "mk": "discsim.drag.published.mk:SCHEME",
        "lab14": "discsim.drag.published.lab14:SCHEME",
        "reconstructed": "discsim.drag.published.reconstructed:SCHEME",
        "esph": "discsim.drag.published.esph:SCHEME",
        "isph": "discsim.drag.published.isph:SCHEME",
        "sios-ppm": "discsim.drag.published.sios_ppm:SCHEME",
        "emsi-ppm": "discsim.drag.published.emsi_ppm:SCHEME",
    },
    required=("kick", "advance", "cells"),
)
DEFAULT_SCHEME = "tsc"  # warnings about other schemes recommend it

# Initial conditions: values of `initial.kind`.
STARTS = Registry(
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
        "streaming": "discsim.initial.streaming:START",
        "blast": "discsim.initial.blast:START",
        "settling": "discsim.initial.settling:START",
        "vortex": "discsim.initial.vortex:START",
    },
    required=("keys", "particles", "rules"),
)

# Effects by the name of their table in a scene, in the order in which a step calls them.
EFFECTS = Registry(
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
        "shearing_box": "discsim.effects.shearing_box:Effect",
        "cooling": "discsim.effects.cooling:Effect",
        "drag": "discsim.effects.drag:Effect",
        "dust_diffusion": "discsim.effects.dust_diffusion:Effect",
        "damping": "discsim.effects.damping:Effect",
        "growth": "discsim.effects.growth:Effect",
    },
    required=("keys", "rules", "begin"),
)

# Fields of snapshots without the species in front; gas and dust have the same fields of motion.
GAS_FIELDS = (
    "surface_density", "density", "temperature", "pressure", "sound_speed", "aspect_ratio", "toomre_q", "h",
)  # fmt: skip
DUST_FIELDS = ("surface_density", "stokes", "stopping_time", "size")
MOTION_FIELDS = ("v_r", "v_phi", "v_phi_excess", "v_x", "v_y", "v_across", "eccentricity", "radius", "x", "y")


def _fields_of(species: str, names: Sequence[str]) -> dict[str, str]:
    """Return the locations of fields of a species by name: `names`, and the fields of motion."""
    own = {f"{species}.{name}": f"discsim.output.fields.{species}:{name}" for name in names}
    return own | {f"{species}.{name}": f"discsim.output.fields.motion:{species}_{name}" for name in MOTION_FIELDS}


# Fields of snapshots: names for `discsim plot --field` and `snap.field`.
FIELDS = Registry(
    "discsim.fields",
    {
        **_fields_of("gas", GAS_FIELDS),
        **_fields_of("dust", DUST_FIELDS),
        "small_dust.surface_density": "discsim.output.fields.dust:small_surface_density",
        "dust_to_gas": "discsim.output.fields.combined:dust_to_gas",
        "optical_depth": "discsim.output.fields.combined:optical_depth",
        "emission": "discsim.output.fields.combined:emission",
    },
    required=("kind", "species", "values"),
)

# Gas models; a scene uses the first one that fits. Other packages cannot add gas models or integrators.
MODELS = (
    "discsim.effects.models:GIVEN_DISC",
    "discsim.effects.models:FIXED_CELLS",
    "discsim.effects.models:POLAR_CELLS",
    "discsim.effects.models:SPH",
)

# Integrators: values of `run.integrator`.
INTEGRATORS = {
    "kdk": "discsim.run.integrators:kdk",
    "euler": "discsim.run.integrators:euler",
}
