"""Random combinations of tables load, are checked, step three times, and give a row; or they end in one clear error."""

from collections import Counter

import pytest
from fuzz import outcome, scene_of


def outcomes(seeds, **choices):
    """How many scenes end in which way; one that ends otherwise is told with its seed."""
    found = Counter()
    for seed in seeds:
        try:
            found[outcome(scene_of(seed, **choices))] += 1
        except Exception as error:
            error.add_note(f"seed {seed}, {choices}: {scene_of(seed, **choices)}")
            raise
    return found


def test_some_random_scenes():
    """With kernels that other tests compile as well."""
    found = outcomes(range(1000, 1015), schemes=("tsc",), kernels=("cubic",))
    assert found["ran"] >= 6


def test_a_scene_whose_collapse_is_beyond_floats():
    """Its warnings are made without numpy's own."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 0.95, "threads": 1}, "space": {"size": 5.0, "cells": 22},
        "initial": {"kind": "disc", "inner": 0.8, "outer": 1.76, "toomre_q": 0.7},
        "gas": {"particles": 29, "eos": {"kind": "polytropic", "constant": 5.17e29, "gamma": 2.83}, "viscosity": {}},
        "star": {"mass": 1.14e-3, "softening": 0.023}, "self_gravity": {"softening": 0.0626},
    }  # fmt: skip
    assert outcome(scene) == "SceneError"  # one message: its numbers make no start


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 600, 20))
def test_random_scenes(first):
    """Each twenty have a scheme and each sixty a kernel of their own."""
    assert outcomes(range(first, first + 20))["ran"] >= 3
