"""Measure spiral arms and clumps of a self-gravitating disc: amplitudes of modes, and what each clump contains.

    discsim analyse clumps DIR [-o OUT] [--size R] [--times]
    python analysis/clumps.py ...                               the same, from a copy of this script

DIR is the directory of a run. The amplitude A_m of a species is the largest over rings of |sum m exp(i m phi)| / sum m,
where the median Poisson noise of each ring is subtracted in squares. The script prints it at the start and at the end,
and its largest value; with --times it prints all amplitudes for each snapshot.

A clump is a peak of the surface density of the gas at the end, on a map with pixels of the size R, that exceeds the
surface density at its radius at the start by the factor 10. Its members are the particles within 3 R. It is bound if
"bound", |W| / (K + U), is above 1: the potential energy W of its members, softened by R, over their kinetic energy K
about the centre of mass and their heat U. R is a length like "1.5 au", by default the softening of the self-gravity,
without it one code unit; a plain number is in au, for runs in code units in code units. The script lists the clumps,
and writes them into clumps.csv in OUT or DIR, with units in the heads of columns.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter

from discsim.output.fields.frame import in_code
from discsim.output.results import (
    display_unit,
    length_in_code,
    positive_text,
    print_fault,
    print_table,
    script_parser,
    with_unit,
    write_table,
)
from discsim.output.snapshot import Snapshot, SnapshotParticles, read_snapshot, snapshot_files
from discsim.printable import UserError

MODES = range(1, 7)
RINGS = 12
THRESHOLD = 10.0
COLUMNS = ("x", "y", "over", "gas", "dust", "ratio", "bound")
MIN_PIXELS, MAX_PIXELS = 16, 8192  # of the map in which peaks are searched, on a side


class InputError(UserError):
    """A run or an option that does not suit the measurement; the message has the reason."""


def amplitudes(pos: np.ndarray, mass: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return A_m for MODES: the largest over the rings between `edges`, without the mean of random angles."""
    radius, angle = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
    ring = np.digitize(radius, edges) - 1
    found = np.zeros((len(edges) - 1, len(MODES)))
    for k in range(len(edges) - 1):
        m, phi = mass[ring == k], angle[ring == k]
        if len(m) < 100:
            continue
        power = [abs((m * np.exp(1j * n * phi)).sum()) ** 2 for n in MODES]
        found[k] = np.sqrt(np.maximum(np.array(power) - (m**2).sum(), 0)) / m.sum()
    return found.max(axis=0)


def clumps(snap: Snapshot, first: Snapshot, size: float) -> list[dict[str, float]]:
    """Return position, peak over the start and masses of each clump, the heaviest first.

    size: radius of a clump, in code units. Raises InputError if the map would have too few or too many pixels.
    """
    reach = float(np.quantile(first.gas.radius, 0.999)) * 1.3
    if not MIN_PIXELS <= 2 * reach / size <= MAX_PIXELS:
        low, high, own = (
            snap.units.show(length, "length") for length in (2 * reach / MAX_PIXELS, 2 * reach / MIN_PIXELS, size)
        )
        raise InputError(f"--size {own}: expected the radius of a clump, {low} to {high}")
    pixels = int(np.ceil(2 * reach / size))
    corner = np.full(2, -reach), np.full(2, reach)
    sigma = snap.gas.surface_density_map(*corner, pixels)
    edges = np.linspace(0, reach, 60)
    start = np.interp(np.linspace(0, reach, 59), 0.5 * (edges[1:] + edges[:-1]), first.gas.radial_profile(edges))
    x = (np.arange(pixels) + 0.5) * 2 * reach / pixels - reach
    radius = np.hypot(x[:, None], x)
    background = np.interp(radius, np.linspace(0, reach, 59), start)
    peaks = (sigma == maximum_filter(sigma, 5)) & (sigma > THRESHOLD * np.maximum(background, start.max() * 1e-2))
    found = []
    for i, j in zip(*np.nonzero(peaks), strict=True):
        place = np.array([x[i], x[j]])
        inside = {k: np.hypot(*(p.pos - place).T) < 3 * size for k, p in snap.species.items()}
        gas = float(snap.gas.mass[inside["gas"]].sum())
        dust = float(snap.dust.mass[inside["dust"]].sum()) if snap.dust is not None else 0.0
        over = float(sigma[i, j] / max(background[i, j], start.max() * 1e-2))
        bound = boundness([(p, inside[k]) for k, p in snap.species.items()], size)
        found.append(
            {
                "x": place[0],
                "y": place[1],
                "over": over,
                "gas": gas,
                "dust": dust,
                "ratio": dust / gas if gas > 0.0 else np.nan,
            }
            | {"bound": bound}
        )
    return sorted(found, key=lambda clump: -clump["gas"])


def boundness(parts: list[tuple[SnapshotParticles, np.ndarray]], size: float) -> float:
    """Return |W| / (K + U) of particles, with attraction softened by `size`; isothermal gas has the heat m c_s^2."""
    pos, vel, mass = (
        np.concatenate([getattr(p, name)[inside] for p, inside in parts]) for name in ("pos", "vel", "mass")
    )
    heat = 0.0
    for p, inside in parts:
        if p.sound_speed is not None:
            heat += float((p.mass * (p.u if p.u is not None else p.sound_speed**2))[inside].sum())
    vel = vel - mass @ vel / mass.sum()
    kinetic = 0.5 * float(mass @ (vel**2).sum(axis=1))
    pull = -0.5 * float((mass**2).sum()) / size  # of each particle on itself, which the sum below includes
    for at, m in zip(pos, mass, strict=True):
        pull += 0.5 * m * float((mass / np.sqrt(((pos - at) ** 2).sum(axis=1) + size**2)).sum())
    return pull / (kinetic + heat)


def read(directory: Path) -> list[Snapshot]:
    """Return the snapshots of a run relative to the centre of the disc; only the last one has velocities and heat.

    Raises InputError, SnapshotError.
    """
    *others, last = snapshot_files(directory)
    run = [read_snapshot(file, ()).about_centre() for file in others] + [read_snapshot(last).about_centre()]
    if run[0].dimensions != 2 or run[0].gas is None:
        raise InputError(f"{directory}: no gas in two dimensions; expected the run of a disc with [gas]")
    return run


def show_modes(run: list[Snapshot], found: np.ndarray, is_in_time: bool) -> None:
    """Print the amplitudes `found` (snapshots, species, modes), one line per species and mode, or one per snapshot."""
    factor, unit = display_unit(run[0].units, "time", "yr")
    times, kinds = [factor * snap.time for snap in run], list(run[0].species)
    if is_in_time:
        head = [f"time [{unit}]", *(f"{kind} A{m}" for kind in kinds for m in MODES)]
        lines = [[time, *map(float, row.ravel())] for time, row in zip(times, found, strict=True)]
        print_table("Amplitudes of modes", head, lines)
        return
    rows: list[list[object]] = [
        [f"A{m} of the {kind}", *(float(a) for a in (series[0], series[-1], series.max())), times[series.argmax()]]
        for k, kind in enumerate(kinds)
        for m, series in zip(MODES, found[:, k].T, strict=True)
    ]
    head = ["amplitude", "start", "end", "largest", f"at time [{unit}]"]
    span = f"{times[0]:.4g} to {times[-1]:.4g} {unit}"
    print_table(f"Amplitudes of modes, |sum m exp(i m phi)| / sum m in the ring with the largest, {span}", head, rows)


def default_size(snap: Snapshot) -> float:
    """Return the softening of the self-gravity in code units; 1 without one."""
    softening = snap.tables.get("self_gravity", {}).get("softening", 1.0)
    return in_code(snap.units, softening, "length") or 1.0


def table_of(last: Snapshot, found: list[dict[str, float]]) -> tuple[list[tuple[str, str]], list[list[float]]]:
    """Return names and units of the columns, and one row for each clump."""
    (length, au), (mass, earth) = (display_unit(last.units, *each) for each in (("length", "au"), ("mass", "Mearth")))
    factors = (length, length, 1.0, mass, mass, 1.0, 1.0)
    units = (au, au, "", earth, earth, "", "")
    rows = [[factor * clump[name] for factor, name in zip(factors, COLUMNS, strict=True)] for clump in found]
    return list(zip(COLUMNS, units, strict=True)), rows


def show_clumps(last: Snapshot, found: list[dict[str, float]], size: float) -> None:
    """Print one line for each clump, with units."""
    time, yr = display_unit(last.units, "time", "yr")
    columns, rows = table_of(last, found)
    title = f"{len(found)} clump{'s' * (len(found) != 1)} at {time * last.time:.4g} {yr}"
    title += f", with R = {last.units.show(size, 'length')}"
    names = {"over": "Sigma over start", "ratio": "dust / gas", "bound": "|W| / (K + U)"}
    if not found:
        print(f"{title}: no peak of the gas exceeds {THRESHOLD:g} times its surface density at the start")
        return
    print_table(title, [f"{names.get(name, name)} [{unit}]" if unit else names[name] for name, unit in columns], rows)
    bound = sum(clump["bound"] > 1.0 for clump in found)
    print(f"{bound} of {len(found)} are bound: |W| / (K + U) is above 1. Masses are those within 3 R")


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("directory", type=Path, metavar="DIR", help="directory of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help="directory of clumps.csv (default DIR)")
    parser.add_argument(
        "--size",
        type=positive_text,
        metavar="R",
        help='radius of a clump, like "1.5 au" (default: the softening of the self-gravity)',
    )
    parser.add_argument("--times", action="store_true", help="print the amplitudes of each snapshot")
    given = parser.parse_args(arguments)
    into = (given.output or given.directory) / "clumps.csv"
    try:
        run = read(given.directory)
        edges = np.quantile(run[0].gas.radius, np.linspace(0.02, 0.98, RINGS + 1))
        modes = np.array([[amplitudes(p.pos, p.mass, edges) for p in snap.species.values()] for snap in run])
        size = default_size(run[-1]) if given.size is None else length_in_code(given.size, run[-1].units, "--size")
        found = clumps(run[-1], run[0], size)
        columns, rows = table_of(run[-1], found)
        write_table(into, [with_unit(*column) for column in columns], rows)
    except (UserError, OSError) as error:
        return print_fault("clumps", error)
    show_modes(run, modes, given.times)
    show_clumps(run[-1], found, size)
    print(into)
    return 0


if __name__ == "__main__":
    sys.exit(main())
