"""What figures show of grains: mean size and Stokes number, and small dust that gas carries."""

from dataclasses import replace

import numpy as np
import pytest

from discsim.numerics.state import Dust
from discsim.output import figure
from discsim.output.drawing import common_norm, map_picture
from discsim.output.fields.values import fields_on_pixels, smooth_profile
from discsim.output.snapshot import SnapshotParticles, read_snapshot
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

COUNT = 6000
WINDOW = np.full(2, -4.0), np.full(2, 4.0)
SCENE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 8.0},
    "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 1.0, "outer": 3.0},
    "gas": {"particles": 100, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": {"particles": COUNT, "ratio": 0.01, "grain_size": 1e-3, "grain_density": 1.0},
    "star": {"mass": 1.0},
    "drag": {"law": "epstein"},
}


def snapshot(tmp_path, mass=None, without_gas=()):
    """Beyond r = 2 a third of the mass is in grains of .001 and two thirds in those of .004; within, all of .01."""
    rng = np.random.default_rng(1)
    r = 1.0 + 2.0 * (np.arange(COUNT) + 0.5) / COUNT
    phi = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0))
    pos = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)
    small = rng.permutation(COUNT) % 2 == 0
    size = np.where(r < 2.0, 0.01, np.where(small, 0.001, 0.004))
    mass = np.where(small, 1.0, 2.0) * 1e-9 if mass is None else mass
    zero = np.zeros_like(pos)
    dust = Dust(pos=pos, vel=zero, acc=zero, mass=mass, ids=np.arange(COUNT), species=np.zeros(COUNT, int), size=size)
    stokes = 30.0 * size
    stokes[list(without_gas)] = np.inf
    write_snapshot(tmp_path / "a.h5", load_scene(SCENE), 0.0, None, dust, {"dust": {"stokes": stokes}})
    return read_snapshot(tmp_path / "a.h5")


def test_maps_are_means_over_mass(tmp_path):
    snap = snapshot(tmp_path)
    assert figure._grain_fields(snap) == ["dust.size", "dust.stokes"]
    centres = -4.0 + 8.0 / 160 * (np.arange(160) + 0.5)
    r = np.hypot(*np.meshgrid(centres, centres))
    for name, unit in (("size", 1.0), ("stokes", 30.0)):
        mean = snap.field(f"dust.{name}", WINDOW, 160).value
        # Gaussians are .1 wide and end at 3.5 widths.
        np.testing.assert_allclose(mean[(r > 1.1) & (r < 1.5)], 0.01 * unit, rtol=1e-3)
        # (1 * .001 + 2 * .004) / 3; a pixel's Gaussian has some ten grains, 8,000 pixels have all.
        assert np.mean(mean[(r > 2.2) & (r < 2.8)]) == pytest.approx(0.003 * unit, rel=0.02)
        assert np.isnan(mean[(r < 0.6) | (r > 3.6)]).all()


def test_means_leave_out_grains_without_gas(tmp_path):
    """Their Stokes numbers are infinite; of the grains with gas within r = 2 all have 0.3."""
    snap = snapshot(tmp_path, without_gas=range(0, 1200, 3))
    mean = snap.field("dust.stokes", WINDOW, 160).value
    centres = -4.0 + 8.0 / 160 * (np.arange(160) + 0.5)
    r = np.hypot(*np.meshgrid(centres, centres))
    np.testing.assert_allclose(mean[(r > 1.1) & (r < 1.5)], 0.3, rtol=1e-3)
    edges, binned = smooth_profile(snap, (1.0, 3.0))
    at = 0.5 * (edges[1:] + edges[:-1])
    np.testing.assert_allclose(binned["dust.stokes"][(at > 1.1) & (at < 1.5)], 0.3, rtol=1e-3)


def test_the_figure_has_them(tmp_path):
    snap = snapshot(tmp_path)
    drawn = figure._figure_2d(snap)
    labels = [axes.get_ylabel() for axes in drawn.findobj(lambda a: hasattr(a, "get_ylabel"))]
    assert {"grain size $s$", "Stokes number"} <= set(labels)
    figure.last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
    plain = replace(snap, dust=replace(snap.dust, size=None))
    assert len(figure._figure_2d(plain).axes) < len(drawn.axes)


@pytest.mark.parametrize("factor", [1.0, 1.3e-7])
def test_the_label_of_the_profile_is_within_the_figure(tmp_path, monkeypatch, factor):
    """Numbers like 2e-12, on an axis over less than two decades, are wider than others."""

    def without_edges(snap, ends):
        edges, binned = smooth_profile(snap, ends)
        sigma = binned["dust.surface_density"]
        return edges, {"dust.surface_density": np.maximum(sigma, 0.06 * sigma.max())}

    monkeypatch.setattr(figure, "smooth_profile", without_edges)
    axes = figure._figure_2d(snapshot(tmp_path, mass=factor * np.full(COUNT, 3.1e-4))).axes[-1]
    assert any("10^" in text.get_text() for text in axes.get_yticklabels()) == (factor < 1.0)
    assert (axes.bbox.x0 > (figure.LEFT + 0.01) * figure.DPI) == (factor < 1.0)
    assert axes.yaxis.get_tightbbox().x0 > 0.05 * figure.DPI


def test_grains_without_mass_or_of_one_size(tmp_path):
    nothing = snapshot(tmp_path, mass=np.zeros(COUNT))
    assert figure._grain_fields(nothing) == []
    figure._figure_2d(nothing)
    picture = map_picture(fields_on_pixels(nothing, WINDOW, 40), "dust.size", WINDOW)
    assert np.isnan(picture.values).all() and common_norm([picture]).vmin > 0.0
    some = snapshot(tmp_path, mass=np.where(np.arange(COUNT) < COUNT // 2, 1e-9, 0.0))
    figure._figure_2d(some)
    norm = common_norm([replace(picture, values=np.full((3, 3), 0.01))])
    assert norm.vmin < 0.01 < norm.vmax


def test_small_dust_beside_grown(tmp_path):
    """Gas that carries a fifth of its mass: a profile of its own, a quarter of that of the gas alone."""
    snap = snapshot(tmp_path)
    assert not [line for line in figure._figure_2d(snap).axes[-1].lines if line.get_label() == "small dust"]
    dust = snap.dust
    mass, small = np.full(COUNT, 1e-7), np.full(COUNT, 2e-8)
    gas = SnapshotParticles(dust.units, {}, dust.pos, dust.vel, mass, dust.ids, small=small)
    snap = replace(snap, gas=gas)
    axes = figure._figure_2d(snap).axes[-1]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert set(lines) == {"gas", "grown dust", "small dust"}
    seen = np.isfinite(lines["gas"])
    np.testing.assert_allclose(lines["small dust"][seen], 0.25 * lines["gas"][seen], rtol=1e-12)
