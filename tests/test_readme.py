"""The README and the pages of docs/ say what the code does: keys, setups, scenes, commands, columns."""

import importlib.util
import re
import shlex
import tomllib
from pathlib import Path

import matplotlib
import pytest
from drags import NOT_CONSERVING, OF_PARTICLES, ON_GRID
from PIL import Image
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.exact import __path__ as exact_path
from discsim.output.history import COLUMNS
from discsim.parts import EFFECTS
from discsim.preview.reference import effects_text, scene_markdown
from discsim.scene.fields import models_in
from discsim.scene.tables import TABLES
from discsim.scene.units import Units

HOME = Path(__file__).parents[1]
FOUND = [HOME / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
FOUND += sorted(HOME.glob("docs/*.md")) + sorted(HOME.glob("docs/[!_]*/*.md"))
FILES = {str(path.relative_to(HOME)): path for path in FOUND}
PAGES = {name: path.read_text(encoding="utf-8") for name, path in FILES.items()}
TEXT = PAGES["README.md"]
OF_EXTRAS = ("mypy", "pre-commit", "ruff", "sphinx-build")  # commands that come with them
LINKS = [(name, link) for name, text in PAGES.items() for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)]


def blocks(language, *names):
    """The blocks of code in a language, of some pages or of all but the recipes, which have tests of their own."""
    pages = names or [page for page in PAGES if not page.startswith("docs/recipes/")]
    found = [each for page in pages for each in re.findall(r"^```(.*)\n((?s:.*?))^```$", PAGES[page], re.M)]
    return [text for name, text in found if name == language]


def module_of(script):
    """The module of a script that is no part of the package."""
    spec = importlib.util.spec_from_file_location(Path(script).stem, HOME / script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_keys_are_those_of_the_code():
    """The page includes what the build makes of the tables."""
    made = "_generated/keys.md"
    assert f"```{{include}} {made}\n```" in PAGES["docs/keys.md"]
    script = (HOME / "docs/pages.py").read_text(encoding="utf-8")
    assert '"keys.md": reference.scene_markdown()' in script


def test_every_table_has_its_keys_on_the_page_and_in_the_command():
    """Told from the tables themselves, not from the list that the generator goes through."""
    told, page = "\n" + effects_text(), scene_markdown()
    for name, annotation in TABLES.items():
        part = page.split(f"`[{name}]`", 1)[1]
        assert f"\n[{name}]\n" in told
        for model in models_in(annotation):
            for key, field in model.model_fields.items():
                if key != "kind" and not models_in(field.annotation):
                    assert f"| `{key}` |" in part and f"    {key} " in told.split(f"\n[{name}]\n", 1)[1], (name, key)


def test_every_setup_is_named_and_exists():
    there = {path.stem for path in (HOME / "setups").glob("*.toml")}
    assert sorted(re.findall(r"\[`(\w+)`\]\(#\1\)", PAGES["docs/gallery.md"])) == sorted(there)
    for name, text in PAGES.items():
        assert set(re.findall(r"setups/(\w+)\.toml", text)) <= there, name
        assert set(re.findall(r"discsim (?:run|check|cost|new) ([a-z_]+)(?![\w./])", text)) <= there, name


def test_the_gallery_runs_setups_as_they_can_be():
    """Each change that makes a run of the gallery short leaves a scene that loads."""
    gallery = module_of("docs/gallery.py")
    for name, changes in gallery.SMALLER.items():
        assert load_scene(HOME / f"setups/{name}.toml", changes)
    for name, picture in gallery.SHIPPED.items():
        assert (HOME / f"setups/{name}.toml").is_file() and (HOME / "analysis/figures" / picture).is_file()
    entries = gallery.markdown(quick=True)
    for name, each in gallery.setups().items():
        assert f"\n## {each.title}\n" in "\n" + entries and f"`discsim run {name}`" in entries


@pytest.mark.parametrize("name, link", LINKS, ids=lambda text: text)
def test_links_lead_somewhere(name, link):
    assert (FILES[name].parent / link).is_file()


def test_files_that_are_named_exist():
    for name, text in PAGES.items():
        for path in re.findall(r"\b((?:discsim|tests|analysis|setups|docs)/[\w/]+\.(?:py|toml|md|png))", text):
            assert (HOME / path).is_file() or "NAME" in path, (name, path)


@pytest.mark.parametrize("text", blocks("toml"), ids=lambda text: tomllib.loads(text)["title"])
def test_scene_is_valid(text, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    for name in re.findall(r'file = "(\w+\.txt)"', text):  # the page has a command that makes it
        (tmp_path / name).write_text("# r  Sigma\n0.3 1.0\n3.1 0.7\n")
    assert load_scene(path).title


def test_examples_of_quantities_have_their_dimension():
    rows = re.findall(r'^\| ([a-z ,-]+) \| (.*`".*) \|$', PAGES["docs/scene.md"], re.M)
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
    assert len([text for text in blocks("sh", "README.md") if text.startswith("python3 -m venv .venv && ")]) == 2
    assert f"Python {project['requires-python'].removeprefix('>=')} or later" in TEXT
    for line in commands:
        for extra in re.findall(r"\.\[(\w+)\]", line):
            assert extra in project["optional-dependencies"]
        for script in re.findall(r"\.venv/bin/([\w-]+)", line):
            assert script in {*project["scripts"], "activate", "pip", "python", *OF_EXTRAS}
        for path in re.findall(r"(?:setups|analysis)/\S+", line):
            assert (HOME / path).is_file()


def test_options_are_those_of_the_commands():
    usage = next(text for text in blocks("", "docs/commands.md") if text.startswith("discsim run"))
    for line in usage.splitlines():
        command = line.split()[1:3] if line.startswith("discsim analyse") else [line.split()[1]]
        shown = CliRunner().invoke(app, [*command, "--help"]).stdout
        assert set(re.findall(r"--\w+", shown)) - {"--help", "--output"} == set(re.findall(r"--\w+", line))


def test_names_are_complete():
    columns = PAGES["docs/output.md"].split("Columns of `history.csv`:")[1].split("\n\n")[1]
    assert tuple(re.findall(r"`(\w+)`", columns)) == COLUMNS
    physics = "".join(text for name, text in PAGES.items() if name.startswith("docs/physics/"))
    for name in (*EFFECTS, "gas.viscosity", "gas.conductivity"):
        assert f"`[{name}]`" in physics and (f"```{{docstring}} {name}\n" in physics or "." in name)
    effects = PAGES["docs/physics/drag.md"]
    for name in (*OF_PARTICLES, *ON_GRID):
        assert f"\n### `{name}`\n\n```{{docstring}} {name}\n" in effects
    for name in OF_PARTICLES:
        kept = "not conserved" if name in NOT_CONSERVING else "exact for each (cell|node|pair)"
        assert re.search(rf"^\| `{name}`.*\| {kept} \|$", effects, re.M)
    for name in ON_GRID:
        kept = "not conserved unless eps = 1" if name in NOT_CONSERVING else "exact for each cell"
        assert re.search(rf"^\| `{name}`.*\| {kept} \|$", effects, re.M)
    solutions = PAGES["docs/physics/exact.md"].split("# Exact solutions")[1].split("\n\n")[2]
    files = {path.stem for path in Path(exact_path[0]).glob("[!_]*.py")}
    assert set(re.findall(r"`(\w+)`", solutions)) == files


@pytest.mark.parametrize(
    "text",
    blocks("python", "README.md") + blocks("python", "docs/api.md")[:3],
    ids=["readme", "simulation", "own particles", "own force"],
)
def test_python_runs(text, tmp_path, monkeypatch):
    (tmp_path / "setups").symlink_to(HOME / "setups")
    monkeypatch.chdir(tmp_path)  # examples write files
    exec("import discsim\n" + text, {})


def test_arrays_have_the_shapes_that_are_told(monkeypatch):
    sim = Simulation(load_scene(HOME / "setups/disc.toml", ["gas.particles=50", "dust.particles=20", "space.cells=16"]))
    rows = re.findall(r"^\| `([\w.]+)` \| (\(n.*?\)) \|", PAGES["docs/api.md"], re.M)
    assert len(rows) == 11
    for name, shape in rows:
        kind, _, array = name.rpartition(".")
        for each in (kind,) if kind else ("gas", "dust"):
            found, n = getattr(getattr(sim, each), array), {"gas": 50, "dust": 20}[each]
            if array == "u":
                assert found is None  # no adiabatic gas
            else:
                assert found.shape == {"(n, d)": (n, 2), "(n,)": (n,)}[shape], name


def test_the_tutorial_is_followed(tmp_path, monkeypatch):
    """Its commands from `new` to the last picture, with few particles and a short time."""
    monkeypatch.chdir(tmp_path)
    few = ["gas.particles=300", "dust.particles=200", "space.cells=32", "run.until=3 yr"]
    lines = [line for text in blocks("sh", "docs/tutorial.md") for line in text.splitlines()]
    followed = [line.split() for line in lines if re.match("discsim (?!cost)", line) and " -o " not in line]
    assert [words[1] for words in followed] == ["setups", "new", "check", "run"]
    for _, verb, *words in followed:
        done = CliRunner().invoke(app, [verb, *words, *(f"--set={change}" for change in few if verb == "run")])
        assert done.exit_code == 0, done.stderr
    (text,) = blocks("python", "docs/tutorial.md")
    with matplotlib.rc_context({"backend": "agg"}):
        exec(text, {})
    assert (tmp_path / "dust.png").is_file() and (tmp_path / "runs/my/last_state.png").is_file()
    for line in lines:
        if "--set" in line or "--without" in line:
            words = shlex.split(line)
            changes = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
            without = [words[i + 1] for i, word in enumerate(words) if word == "--without"]
            assert load_scene(tmp_path / words[2], changes, without)


def test_pictures_keep_their_colours():
    """A palette of 256 colours, which two maps share, shows as bands in their colour bars."""
    for path in (HOME / "analysis/figures").glob("*.png"):
        with Image.open(path) as image:
            assert image.mode in ("RGB", "RGBA"), path


def test_pictures_of_whole_runs_are_made_by_one_script():
    pictures = module_of("analysis/pictures.py")
    for name, (setup, changes, _) in pictures.PICTURES.items():
        assert load_scene(HOME / f"setups/{setup}.toml", changes) and (HOME / f"analysis/figures/{name}.png").is_file()
    shipped = {name for name, picture in module_of("docs/gallery.py").SHIPPED.items() if name == Path(picture).stem}
    assert shipped <= pictures.PICTURES.keys()


def test_films_of_the_gallery_are_small_and_are_made_by_the_same_script():
    """A page shows each film with controls, without sound, within the page on a phone, and says what it shows."""
    pictures, gallery = module_of("analysis/pictures.py"), module_of("docs/gallery.py")
    assert sorted(pictures.FILMS) == [f"film_{name}" for name in sorted(gallery.FILMS)]
    for setup, changes, (command, *options) in pictures.FILMS.values():
        assert load_scene(HOME / f"setups/{setup}.toml", changes) and command == "movie"
        assert set(options[::2]) <= set(re.findall(r"--\w+", CliRunner().invoke(app, ["movie", "--help"]).stdout))
        film = HOME / f"docs/_static/films/{setup}.mp4"
        assert film.read_bytes()[4:8] == b"ftyp" and 10_000 < film.stat().st_size < 500_000
        shown = "\n".join(gallery.film(setup))
        for name in re.findall(r'(?:src|poster)="(\S+)"', shown):
            assert (HOME / "docs" / name).is_file()
        attributes = set(re.search(r"<video (.*?) poster", shown)[1].split())
        assert {"controls", "muted", "loop", "playsinline"} <= attributes
        with Image.open(film.with_suffix(".jpg")) as still:
            assert min(still.size) > 400
        assert shown.count(gallery.FILMS[setup]) == 3  # for screen readers, without video, and below the film


def test_differences_of_radii_are_those_of_the_table():
    """Two-way less one-way, after 40 orbits, by the number of particles and of the model."""
    text = PAGES["docs/backreaction.md"]
    rows = re.findall(r"^\| (one|two)-way, ([\w,]+).*? \| 40 \| [\d.]+ \| ([\d.]+) \|", text, re.M)
    median = {(way, what): float(r50) for way, what, r50 in rows}
    words = [rf"([\d.]+) {what}" for what in ("with 100,000 particles", "with 45,000", "with 20,000", "in the")]
    found = re.search("r50 differs [a-z- ]+ by " + r",? (?:and )?by\s+".join(words), text)
    for what, told in zip(("100,000", "45,000", "20,000", "radial"), found.groups(), strict=True):
        assert float(told) == pytest.approx(median["two", what] - median["one", what], abs=1e-9)


def test_a_duration_is_told_in_one_place():
    """How long a setup takes is in its header, the first compilation on the page of installing."""
    told = re.compile(r"compil[^.]*(?:minute|seconds|\d s\b)")
    pages = {name: text for name, text in PAGES.items() if name != "CHANGELOG.md"}
    assert [name for name, text in pages.items() if told.search(text)] == ["docs/install.md"]
    assert "[some minutes](setups/dusty_disc.toml)" in TEXT
