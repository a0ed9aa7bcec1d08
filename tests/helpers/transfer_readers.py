"""Readers of the input of RADMC-3D and MCFOST, written from the documentation of both codes alone."""

import numpy as np
from astropy.io import fits


def text_numbers(path):
    """All numbers of a text file without its comments."""
    lines = [line for line in path.read_text().splitlines() if line[:1] != "#" and line[:2] != "--"]
    return np.array([float(word) for line in lines for word in line.split()])


def radmc3d_grid(folder):
    """Edges in r, theta and phi of amr_grid.inp."""
    numbers = text_numbers(folder / "amr_grid.inp")
    assert numbers[:4].tolist() == [1, 0, 100, 0] and numbers[4:7].tolist() == [1, 1, 1]
    counts = numbers[7:10].astype(int)
    ends = np.cumsum(counts + 1)
    assert len(numbers) == 10 + ends[-1]
    return np.split(numbers[10:], ends[:-1])


def radmc3d_volumes(edges):
    """Volumes [phi, theta, r] of spherical cells."""
    r, theta, phi = edges
    parts = np.diff(phi), -np.diff(np.cos(theta)), np.diff(r**3) / 3
    return parts[0][:, None, None] * parts[1][:, None] * parts[2]


def radmc3d_binary(path, shape, several=False):
    """Values of a binary file, in cells [phi, theta, r]; with `several`, by species first."""
    data = path.read_bytes()
    form, size, cells, *species = np.frombuffer(data, "<i8", 4 if several else 3)
    assert (form, size, cells) == (1, 8, np.prod(shape))
    values = np.frombuffer(data, "<f8", offset=8 * (4 if several else 3))
    return values.reshape((*species, *shape) if several else (*shape, -1))


def mcfost_parameters(path):
    """Values of the parameter file by the comment that follows them, and those of lines with a known number."""
    lines = [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    at = {" ".join(words): words for words in lines}

    def line(end):
        return next(words for text, words in at.items() if text.endswith(end))

    shape = [int(word) for word in line("n_rad (log distribution), nz, n_az, n_rad_in")[:4]]
    scale, reference = (float(word) for word in line("vertical profile exponent")[:2])
    inner, _, outer, _ = (float(word) for word in line("Rin, edge, Rout, Rc (AU)")[:4])
    smallest, largest, _, sizes = (
        float(word) for word in line("amin, amax [mum], aexp, n_grains (log distribution)")[:4]
    )
    mass, ratio = (float(word) for word in line("dust mass, gas-to-dust mass ratio")[:2])
    star = [float(word) for word in line("automatic spectrum?")[:5]]
    return {
        "shape": shape, "scale": scale, "reference": reference, "inner": inner, "outer": outer, "mass": mass,
        "flaring": float(line("flaring exponent")[0]), "slope": float(line("surface density exponent")[0]),
        "ratio": ratio, "star": star, "sizes": (smallest, largest, int(sizes)),
    }  # fmt: skip


def mcfost_grid(given):
    """Edges in r (AU), z [r, edge] (AU) and volumes [phi, z, r] in AU^3 of the cylindrical grid of MCFOST 4.1."""
    n_rad, n_z, n_az, inside = given["shape"]
    assert inside == 1 and 1 + given["slope"] - given["flaring"] <= 0  # then all cells have the same width in ln r
    r = given["inner"] * np.exp(np.arange(n_rad + 1) / n_rad * np.log(given["outer"] / given["inner"]))
    top = 7.0 * given["scale"] * (0.5 * (r[1:] + r[:-1]) / given["reference"]) ** given["flaring"]
    z = top[:, None] * np.arange(n_z + 1) / n_z
    volume = np.pi * np.diff(r**2) / n_az * np.diff(z, axis=1).T
    return r, z, np.broadcast_to(volume, (n_az, n_z, n_rad))


def mcfost_sizes(given):
    """Radii in um that MCFOST makes: the middles of bins of equal width in ln a."""
    smallest, largest, count = given["sizes"]
    return smallest * (largest / smallest) ** ((np.arange(count) + 0.5) / count)


def mcfost_opacities(path):
    """Radii in um, wavelengths in um, and kappa [size, wavelength] in cm2/g, by the statements of `misselt_load`."""
    lines = path.read_text().splitlines()
    sizes, wavelengths = (int(lines[k].split()[1]) for k in (8, 9))
    density, at, found = float(lines[10].split()[1]), 13, []
    for _ in range(sizes):
        radius = float(lines[at])
        rows = np.array([line.split() for line in lines[at + 2 : at + 2 + wavelengths]], dtype=float)
        assert rows.shape == (wavelengths, 6) and (rows[:, [3, 5]] == 0).all()  # no scattering
        found.append((radius, rows[:, 1], rows[:, 4] * 0.75 / (density * radius * 1e-4)))
        at += wavelengths + 3
    return np.array([each[0] for each in found]), found[0][1], np.array([each[2] for each in found])


def mcfost_bins(path):
    """Edges in um of the bins of wavelength in a parameter file, of equal width in ln lambda."""
    (line,) = (line for line in path.read_text().splitlines() if "n_lambda, lambda_min" in line)
    count, low, high = (float(word) for word in line.split()[:3])
    return np.geomspace(low, high, int(count) + 1)


def mcfost_density(path):
    """Densities [size, phi, z, r], radii in um, dn/da, density and velocity of the gas."""
    with fits.open(path) as file:
        arrays = [np.array(hdu.data, dtype=float) for hdu in file]
        header = file[0].header
    first = arrays.pop(0)
    sizes = (arrays.pop(0), arrays.pop(0)) if header.get("read_n_a") == 1 else (None, None)
    gas = arrays.pop(0) if header.get("read_gas_density") == 1 else None
    flow = arrays.pop(0) if header.get("read_gas_velocity") == 2 else None
    assert not arrays
    return first if first.ndim == 4 else first[None], *sizes, gas, flow
