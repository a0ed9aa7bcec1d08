"""Options of compilations are equal where numba finds them equal."""

import itertools

from numba.core.compiler import Flags

from discsim.kernels import options

SETS = ({}, {"nrt": True}, {"nrt": False}, {"nrt": True, "forceinline": True}, {"forceinline": True, "nrt": True})


def made(settings):
    flags = Flags()
    for name, value in settings.items():
        setattr(flags, name, value)
    return flags


def test_options_are_equal_where_numba_finds_them_equal():
    for one, other in itertools.product(SETS, SETS):
        one, other = made(one), made(other)
        assert (one == other) == options.one_by_one(one, other) == (one.values() == other.values())
        assert hash(one) == hash(other) == hash(tuple(sorted(one.values())))
    assert made(SETS[0]) == made(SETS[2])  # what is set to what it would be anyway
    assert made(SETS[0]) != 1
