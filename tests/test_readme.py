"""The README says what the code does: keys, setups, scenes, commands, columns."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from drags import NOT_CONSERVING, OF_PARTICLES, ON_GRID

from discsim import load_scene
from discsim.exact import __path__ as exact_path
from discsim.output.history import COLUMNS
from discsim.parts import EFFECTS
from discsim.preview.reference import effects_text, with_reference
from discsim.scene.fields import models_in
from discsim.scene.tables import TABLES
from discsim.scene.units import Units

HOME = Path(__file__).parents[1]
TEXT = (HOME / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.S | re.M)


def blocks(language):
    return [text for name, text in BLOCKS if name == language]


def test_keys_are_those_of_the_code():
    assert with_reference(TEXT) == TEXT, "run: python -m discsim.preview.reference"


def test_every_table_has_its_keys_on_the_page_and_in_the_command():
    """Told from the tables themselves, not from the list that the generator goes through."""
    told = "\n" + effects_text()
    for name, annotation in TABLES.items():
        part = TEXT.split(f"`[{name}]`", 1)[1]
        assert f"\n[{name}]\n" in told
        for model in models_in(annotation):
            for key, field in model.model_fields.items():
                if key != "kind" and not models_in(field.annotation):
                    assert f"| `{key}` |" in part and f"    {key} " in told.split(f"\n[{name}]\n", 1)[1], (name, key)


def test_every_setup_is_named_and_exists():
    named = set(re.findall(r"setups/\w+\.toml", TEXT))
    assert named == {f"setups/{path.name}" for path in (HOME / "setups").glob("*.toml")}


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#:]+)\)", TEXT))
def test_links_lead_somewhere(link):
    assert (HOME / link).is_file()


@pytest.mark.parametrize("text", blocks("toml"), ids=lambda text: tomllib.loads(text)["title"])
def test_scene_is_valid(text, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    assert load_scene(path).title


def test_examples_of_quantities_have_their_dimension():
    rows = re.findall(r'^\| ([a-z ,-]+) \| (.*`".*) \|$', TEXT.split("## Scene reference")[1], re.M)
    assert len(rows) == 7
    for name, texts in rows:
        quantities = re.findall(r'`"([^"]*)"`', texts)
        if ", " in name:  # one example for each
            for one, text in zip(name.split(", "), quantities, strict=True):
                Units().parse(text, one.replace(" ", "_"))
        elif name == "density" or name == "drag coefficient":
            for text, dimensions in zip(quantities, (2, 1), strict=True):
                Units(dimensions=dimensions).parse(text, name.replace(" ", "_"))
        elif name == "pressure":
            Units(dimensions=1).parse(*quantities, name)


def test_commands_install_what_the_project_declares():
    project = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    commands = [line for text in blocks("sh") for line in text.splitlines()]
    assert len([line for line in commands if "pip install" in line]) == 2
    assert f"Python {project['requires-python'].removeprefix('>=')} or later" in TEXT
    for line in commands:
        for extra in re.findall(r"\.\[(\w+)\]", line):
            assert extra in project["optional-dependencies"]
        for script in re.findall(r"\.venv/bin/(\w+)", line):
            assert script in {*project["scripts"], "pip", "python"}
        for path in re.findall(r"(?:setups|analysis)/\S+", line):
            assert (HOME / path).is_file()


def test_options_are_those_of_the_commands():
    usage = next(text for text in blocks("") if text.startswith("discsim run"))
    for line in usage.splitlines():
        command = line.split()[1]
        shown = subprocess.run(
            [sys.executable, "-m", "discsim", command, "--help"], capture_output=True, text=True, check=True
        ).stdout
        assert set(re.findall(r"--\w+", shown)) - {"--help", "--output"} == set(re.findall(r"--\w+", line))


def test_names_are_complete():
    columns = TEXT.split("Columns of `history.csv`:")[1].split("\n\n")[0]
    assert tuple(re.findall(r"`(\w+)`", columns)) == COLUMNS
    effects = TEXT.split("## Effects and their equations")[1].split("### The step")[0]
    for name in (*EFFECTS, "gas.viscosity", "gas.conductivity"):
        assert f"(`[{name}]`" in effects
    for name in OF_PARTICLES:
        kept = "not conserved" if name in NOT_CONSERVING else "exact for each (cell|node|pair)"
        assert re.search(rf"^\| `{name}`.*\| {kept} \|$", effects, re.M)
    for name in ON_GRID:
        kept = "not conserved unless eps = 1" if name in NOT_CONSERVING else "exact for each cell"
        assert re.search(rf"^\| `{name}`.*\| {kept} \|$", effects, re.M)
    solutions = TEXT.split("### Exact solutions")[1].split("\n\n")[1]
    files = {path.stem for path in Path(exact_path[0]).glob("[!_]*.py")}
    assert set(re.findall(r"`(\w+)`", solutions)) == files


@pytest.mark.parametrize("text", blocks("python")[:2], ids=["simulation", "own particles"])
def test_python_runs(text, monkeypatch):
    monkeypatch.chdir(HOME)
    exec("import discsim\n" + text, {})
