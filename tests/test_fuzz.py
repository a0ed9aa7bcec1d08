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
    """With kernels, and terms of theirs, that other tests compile as well."""
    found = outcomes(range(1001, 1009), schemes=("tsc",), kernels=("cubic",))
    assert found["ran"] >= 3


def test_a_scene_whose_collapse_is_beyond_floats():
    """Its warnings are made without numpy's own."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 0.95, "snapshots": 5, "threads": 1},
        "space": {"size": 5.0, "cells": 22},
        "initial": {
            "kind": "disc", "inner": 0.8036499738660134, "outer": 1.7607099368742334, "toomre_q": 0.7012099687665022,
        },
        "gas": {
            "particles": 29, "kernel": "quintic", "eta": 1.4677621488211534, "viscosity": {},
            "eos": {"kind": "polytropic", "constant": 5.167495231107692e29, "gamma": 2.8297127559533863},
        },
        "star": {"mass": 0.0011398436050949346, "softening": 0.022940887357526443},
        "self_gravity": {"softening": 0.06259110747461004},
        "dust": [{"inner": 0.7121426674360826, "particles": 39, "ratio": 0.005}, {"particles": 24, "ratio": 1e-4}],
        "drag": {"law": "stopping-time", "scheme": "mk", "t_stop": 2.9787677932977195},
        "external": {"dust": 0.36292861464392695, "vertical_frequency": 1.8997346913490363},
    }  # fmt: skip
    assert outcome(scene) == "SceneError"  # one message: its numbers make no start


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 600, 20))
def test_random_scenes(first):
    """Each twenty have a scheme and each sixty a kernel of their own."""
    assert outcomes(range(first, first + 20))["ran"] >= 3
