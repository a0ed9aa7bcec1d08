"""The page of a run: well-formed, whole by itself, escaped, and with the numbers of the run's files."""

import base64
import csv
from html.parser import HTMLParser

import numpy as np
import pytest
from runs import SHOCK, scene_of
from typer.testing import CliRunner

from discsim import load_scene
from discsim.cli import app
from discsim.preview.reference import docstring
from discsim.report.conservation import conserved_quantities
from discsim.run.runner import run_scene

TITLE = "<b>Grains & \"gas\"</b> <script>alert('x')</script>"
SCENE = {
    "title": TITLE,
    "units": {"system": "code"},
    "run": {"until": 0.2, "snapshots": 2},
    "space": {"size": 8.0, "cells": 32},
    "initial": {"kind": "disc", "mass": 0.05, "inner": 1.0, "outer": 2.0},
    "gas": {"particles": 600, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
    "dust": {"particles": 200, "ratio": 0.1},
    "drag": {"law": "stokes-number", "stokes": 0.1},
    "star": {"mass": 1.0, "accretion_radius": 1.1},
}
VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """What a page consists of; an end without its beginning is an error."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.text = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def shown(self):
        """With a space between what different tags hold."""
        return " ".join(" ".join(self.text).split())

    def of(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def report(*arguments):
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    directory = tmp_path_factory.mktemp("run") / "a"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(load_scene(SCENE), directory, quiet=True) == 0
    return directory


@pytest.fixture(scope="module")
def page(run):
    done = report(run)
    assert done.exit_code == 0, done.stderr
    return (run / "report.html").read_text(encoding="utf-8")


def rows_of(directory, name):
    with (directory / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_page_is_whole_by_itself(page):
    found = Page(page)
    assert found.tags[0][0] == "html" and page.startswith("<!DOCTYPE html>")
    assert not found.of("script") and not found.of("link") and not found.of("iframe")
    for attribute in ("http:", "https:", "url(", "@import", "javascript:"):
        assert attribute not in page
    assert all(each["href"].startswith("#") for each in found.of("a"))
    ids = {attributes["id"] for _, attributes in found.tags if "id" in attributes}
    assert {each["href"][1:] for each in found.of("a")} <= ids  # links lead somewhere
    images = found.of("img")
    assert len(images) == 4 and all(each["alt"] for each in images)
    for each in images:
        kind, _, data = each["src"].partition(",")
        assert kind == "data:image/png;base64" and base64.b64decode(data, validate=True)[:8] == b"\x89PNG\r\n\x1a\n"


def test_it_fits_a_phone_dark_rooms_and_paper(page):
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in Page(page).of("meta")
    for media in ("prefers-color-scheme: dark", "max-width: 40rem", "@media print"):
        assert media in page
    assert page.count("{") == page.count("}")  # of the style, and of tables in the scene


def test_what_a_scene_says_is_escaped(page, run):
    assert "<b>Grains" not in page and "alert('x')</script>" not in page
    found = Page(page)
    assert found.text[[name for name, _ in found.tags].index("title") and found.text.index(TITLE)] == TITLE
    assert "".join(found.text).count((run / "scene.toml").read_text()) == 1  # letter by letter


def test_effects_have_the_equations_of_the_reference(page):
    shown = " ".join("".join(Page(page).text).split())
    for module in ("effects.gas", "effects.dust", "effects.star", "effects.drag", "drag.tsc"):
        for line in docstring(f"discsim.{module}").replace("`", "").splitlines():
            assert " ".join(line.split()) in shown, line
    assert "stokes 0.1" in shown and "alpha_viscosity" not in Page(page).shown.split("Effects")[1].split("Scene")[0]


def test_it_has_the_numbers_of_the_files(page, run):
    shown = Page(page).shown
    rows = rows_of(run, "history.csv")
    for row in rows_of(run, "costs.csv"):
        assert f"{row['effect']} {row['calls']} {float(row['cpu_seconds']):.3g} s" in shown
    spin = [float(row["angular_momentum"]) for row in (rows[0], rows[-1])]
    change = (spin[1] - spin[0]) / max(float(row["angular_momentum"]) for row in rows)
    assert f"angular momentum {spin[0]:.4g} {spin[1]:.4g} {change:.1e}" in shown
    assert "0 to 0.2; finished" in shown and f"steps {rows[-1]['step']} " in shown and "gas 600 particles" in shown
    warned = [line[9:] for line in (run / "run.log").read_text().splitlines() if line.startswith("warning: ")]
    assert warned and all(line in shown for line in warned)


def test_mass_that_the_star_took_is_counted(run):
    rows = rows_of(run, "history.csv")
    assert float(rows[-1]["accreted_gas"]) > 0.0
    mass = next(each for each in conserved_quantities(load_scene(run / "scene.toml"), rows) if each.name == "mass")
    assert np.abs(mass.change).max() < 1e-14 and mass.causes == ""


def test_what_changes_a_total_is_named():
    """Half as fast again, and 1% of the mass lost, of rows made by hand."""
    scene = load_scene(SCENE | {"external": {"gas": [0.1, 0.0]}})
    row = {"mass_gas": 1.0, "mass_dust": 1.0, "accreted_gas": 0.0, "accreted_dust": 0.0, "momentum_x": 2.0,
           "momentum_y": 0.0, "angular_momentum": 4.0, "kinetic_gas": 0.5, "kinetic_dust": 0.5, "thermal": 1.0,
           "potential": -4.0, "radiated": 0.0}  # fmt: skip
    later = row | {"momentum_x": 3.0, "mass_gas": 0.98, "thermal": 2.0}
    found = {each.name: each for each in conserved_quantities(scene, [row, later])}
    assert found["mass"].change[1] == pytest.approx(-0.01)
    assert found["momentum"].change[1] == pytest.approx(1.0 / 2.0)  # over sqrt(2 * 1 * 2)
    assert found["angular momentum"].change[1] == 0.0
    assert found["energy"].change[1] == pytest.approx(1.0 / 7.0)  # over 1 + 2 + 4
    assert found["momentum"].causes == "changed by [star], [external]"
    assert found["energy"].causes == "changed by [external], the prescribed gas temperature"


def test_a_run_in_one_dimension_that_was_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    assert run_scene(scene_of(tmp_path, SHOCK, "run.walltime=0.001 s"), tmp_path / "a", quiet=True) == 0
    monkeypatch.undo()
    with (tmp_path / "a/history.csv").open("a") as file:
        file.write("7,0.0")  # as a run leaves it that writes just now
    done = report(tmp_path / "a", "-o", tmp_path / "page.html")
    assert done.exit_code == 0, done.stderr
    found = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "0 to 0; stopped before its end at 0.1" in found.shown and "stopped by run.walltime" in found.shown
    assert "the ends of the tube" in found.shown and len(found.of("img")) == 3
    assert not (tmp_path / "a/report.html").exists()


def test_no_run_there(tmp_path):
    done = report(tmp_path)
    assert done.exit_code == 2 and "no run found; give a directory with scene.toml" in done.stderr
    assert list(tmp_path.iterdir()) == []
