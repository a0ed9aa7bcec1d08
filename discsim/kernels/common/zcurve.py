"""Index along a Z-curve (Morton 1966): the interleaved bits of two integers x and y, each below 2^8."""

from discsim.jit.decorators import inline_jit


@inline_jit
def z_index(x, y):
    """Return the index of (x, y) along the Z-curve. In each pair of bits the higher bit is from x."""
    return _insert_zeros(x) << 1 | _insert_zeros(y)


@inline_jit
def z_position(z):
    """Return (x, y) at the index z along the Z-curve, the inverse of `z_index`."""
    return _take_alternate_bits(z >> 1), _take_alternate_bits(z)


@inline_jit
def _insert_zeros(i):
    """Return the bits of i with a 0 inserted above each."""
    i = (i | i << 4) & 0x0F0F
    i = (i | i << 2) & 0x3333
    return (i | i << 1) & 0x5555


@inline_jit
def _take_alternate_bits(z):
    """Return the number made of every other bit of z, beginning with the lowest bit."""
    z &= 0x5555
    z = (z | z >> 1) & 0x3333
    z = (z | z >> 2) & 0x0F0F
    return (z | z >> 4) & 0x00FF
