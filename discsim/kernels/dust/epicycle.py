"""Epicycles in a shearing box: velocities rotate about a steady drift."""

from discsim.jit.decorators import jit


@jit
def rotate(begin, end, species, steady, cosine, along, back, vel, across):
    """Rotate velocities, in place, by the same angle about the steady drift of each population.

    With the deviation w of a velocity from the drift, w_x becomes cosine w_x + along w_y, and w_y becomes
    cosine w_y - back w_x. species (n,): population of each particle, without entries for gas. steady (populations, 2):
    drift along x and azimuth. vel (n, 2): its column 0 changes. across (n,): azimuthal velocities.
    """
    for i in range(begin, end):
        k = species[i] if len(species) > 0 else 0
        radial, azimuthal = vel[i, 0] - steady[k, 0], across[i] - steady[k, 1]
        vel[i, 0] = steady[k, 0] + cosine * radial + along * azimuthal
        across[i] = steady[k, 1] + cosine * azimuthal - back * radial
