"""The gallery: an entry for each setup that comes with discsim, with its figure.

A figure is made by running the setup, small where SMALLER says so, and kept in _generated/ until the scene, its changes
or the version are others.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from discsim import __version__
from discsim.shipped import Setup, setups

HERE = Path(__file__).parent
KEPT = HERE / "_generated"
# Figures of whole runs that take minutes: analysis/figures.
SHIPPED = {
    "dead_zone_oneway": "dead_zone.png",
    "dead_zone_sph": "dead_zone.png",
    "dead_zone_twoway": "dead_zone.png",
    "disc": "first_disc.png",
    "dusty_disc": "dusty_disc.png",
    "gravitoturbulent": "gravitoturbulent.png",
    "cooling_fragments": "cooling_fragments.png",
    "planet_dust": "planet_dust.png",
    "planet_dust_grid": "planet_dust_grid.png",
    "planet_gap": "planet_gap.png",
    "planet_gap_grid": "planet_gap_grid.png",
    "planet_torque": "planet_torque.png",
    "ring_oneway": "ring.png",
    "ring_twoway": "ring.png",
    "twin_oneway": "oneway_twoway.png",
    "twin_twoway": "oneway_twoway.png",
}
# Films of smaller runs, by `analysis/pictures.py film_NAME`, with what they show in words.
FILMS = {
    "fragmenting_disc": "Spiral arms of dust grow within half an orbit, and break into clumps that orbit the star.",
    "gravitoturbulent": "A smooth disc of gas cools, and spiral arms form, which shear apart and form again.",
    "planet_dust": "One frame for each orbit of the planet: it opens a gap, and dust gathers in rings at the edges.",
    "streaming_clumps": "Grains placed at random gather in filaments, which collide and merge to a few dense clumps.",
}
# What makes the run of a figure a short one. Setups that are in neither list run as they are.
SMALLER = {
    "background_dust": ["dust.particles=20000", "dust.placement=random"],
    "fragmenting_disc": ["gas.particles=8000", "dust.particles=8000", "space.cells=192", 'run.until="400 yr"'],
    "gas_disc": ["gas.particles=15000", 'run.until="150 yr"'],
    "gresho": ["gas.particles=2500", "run.until=0.5"],
    "sedov": ["gas.particles=6400"],
    "settling": ["run.until=3.14"],
    "sheet": ["gas.particles=1024", "space.cells=32"],
    "stable_disc": ["gas.particles=10000", "dust.particles=10000", "space.cells=192", 'run.until="300 yr"'],
    "star_dust": ["dust.particles=20000"],
    "streaming_clumps": ["gas.particles=4000", "dust.particles=4000", "run.until=100"],
}


def markdown(quick: bool, say: Callable[[str], None] = print) -> str:
    """The entries, in the order of the page's table; missing figures are made first, or with `quick` left out."""
    known = setups()
    if not quick:
        KEPT.mkdir(exist_ok=True)
        missing = [each for name, each in known.items() if name not in SHIPPED and not figure(each).exists()]
        if missing:
            say(f"gallery: running {', '.join(each.name for each in missing)}, once")
        with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as workers:
            list(workers.map(draw, missing))
    named = re.findall(r"\(#(\w+)\)", (HERE / "gallery.md").read_text(encoding="utf-8"))
    return "\n".join(line for name in dict.fromkeys(named) for line in entry(known[name]))


def figure(each: Setup) -> Path:
    """Where the figure of a setup is, or will be."""
    if each.name in SHIPPED:
        return HERE.parent / "analysis" / "figures" / SHIPPED[each.name]
    made_of = repr((each.text, SMALLER.get(each.name), __version__))
    return KEPT / f"{each.name}-{hashlib.sha256(made_of.encode()).hexdigest()[:12]}.png"


def draw(each: Setup) -> None:
    """Run a setup for its figure, in place of an older one."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "discsim", "run", str(each.path), "-o", str(out), "--threads", "1", "--quiet"]
        command += [f"--set={change}" for change in SMALLER.get(each.name, ())]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{each.name}: {done.stderr.strip()}")
        for old in KEPT.glob(f"{each.name}-*.png"):
            old.unlink()
        shutil.move(out / "last_state.png", figure(each))


def entry(each: Setup) -> Iterator[str]:
    """A setup as Markdown."""
    yield f"({each.name})=\n## {each.title}"
    yield f"\n{each.about}\n"
    picture = figure(each)
    if picture.exists():
        where = os.path.relpath(picture, HERE)
        yield f"![{each.title}: the state at the end]({where})\n"
        if each.name in SMALLER:
            yield f"*Of a short run, with {', '.join(f'`{change}`' for change in SMALLER[each.name])}.*\n"
    if each.name in FILMS:
        yield from film(each.name)
    seen = each.notes["What you will see"]
    yield f"{seen[0].upper()}{seen[1:]}\n"
    yield from (f"- {label}: {text}" for label, text in each.notes.items() if label != "What you will see")
    yield f"- Run it: `discsim run {each.name}`; copy it: `discsim new {each.name}`\n"
    yield f"<details><summary><code>setups/{each.name}.toml</code></summary>\n"
    yield f"```{{literalinclude}} {os.path.relpath(each.path, HERE)}\n:language: toml\n```\n"
    yield "</details>\n"


def film(name: str) -> Iterator[str]:
    """The film of a setup, which loads only when it is played; the text is for readers without it."""
    path, text = f"_static/films/{name}", FILMS[name]
    yield f'<video controls muted loop playsinline preload="none" poster="{path}.jpg" aria-label="{text}">'
    yield f'<source src="{path}.mp4" type="video/mp4"><a href="{path}.mp4">{text}</a></video>\n'
    yield f"*Film of a smaller run, by `python analysis/pictures.py film_{name} -o OUT`: {text}*\n"
