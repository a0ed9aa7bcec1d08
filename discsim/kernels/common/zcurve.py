"""Index along a Z-curve (Morton 1966): the interleaved bits of two integers below 2^8."""

from discsim.jit.decorators import inline_jit


@inline_jit
def place_of(x, y):
    """Return the index of (x, y) along the curve: x has the higher bit of each pair."""
    return _apart(x) << 1 | _apart(y)


@inline_jit
def at_place(z):
    """Return (x, y) at an index along the curve."""
    return _together(z >> 1), _together(z)


@inline_jit
def _apart(i):
    # The bits of i, with a 0 above each.
    i = (i | i << 4) & 0x0F0F
    i = (i | i << 2) & 0x3333
    return (i | i << 1) & 0x5555


@inline_jit
def _together(z):
    # Every other bit of z, from the lowest on.
    z &= 0x5555
    z = (z | z >> 1) & 0x3333
    z = (z | z >> 2) & 0x0F0F
    return (z | z >> 4) & 0x00FF
