"""Make the pictures of whole runs again: runs of setups, and figures of their ends in `analysis/figures`.

    python analysis/pictures.py first_disc dusty_disc -o OUT

A run that OUT holds is not made again, and one that was stopped goes on. Pictures keep all their colours: a palette of
256 colours would show as bands in the colour bars.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from PIL import Image, PngImagePlugin

HOME = Path(__file__).parents[1]
FIGURES = HOME / "analysis" / "figures"
MAIN = ("gas.particles=6000", "dust.particles=10000", "space.cells=128", "run.until=700 yr")
SKY = ("gas.particles=12000", "dust.particles=40000", "space.cells=256", "run.until=700 yr")
SEEN = ("--distance", "140 pc", "--wavelength", "0.87 mm", "--wavelength", "3 mm", "--inclination", "50 deg")
BEAM = ("--position-angle", "30 deg", "--beam", "0.1 arcsec,0.06 arcsec,60 deg", "--noise", "20 uJy/beam")
GAP = ("gas.particles=8000", "dust.particles=4000", "companion.0.mass=3e-3", "companion.0.ramp=6.28", "run.until=94.2")
MARKS = ("--profile", "--field", "surface_density", "--mark", "companions,damping,gap,initial")
# Picture -> setup, changes of it, and the command that draws the run (none: the figure of the last state).
PICTURES: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "first_disc": ("disc", (), ()),
    "dusty_disc": ("dusty_disc", (), ()),
    "plot_fields": ("dusty_disc", MAIN, ("plot", "--field", "toomre_q,dust_to_gas,dust.v_r")),
    "sky_image": ("dusty_disc", SKY, ("image", *SEEN, *BEAM)),
    "marks": ("planet_dust", (*GAP, "run.snapshots=15"), ("plot", *MARKS)),
    "planet_dust": ("planet_dust", (), ()),
    "planet_gap": ("planet_gap", (), ()),
    "planet_torque": ("planet_torque", (), ()),
    "gravitoturbulent": ("gravitoturbulent", (), ()),
    "cooling_fragments": ("cooling_fragments", (), ()),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=PICTURES, metavar="NAME", help=", ".join(PICTURES))
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="directory of the runs")
    parser.add_argument("--into", type=Path, default=FIGURES, metavar="DIR", help="directory of the pictures")
    options = parser.parse_args()
    for name in options.names:
        store(drawn(name, options.output / name), options.into / f"{name}.png")


def drawn(name: str, run: Path) -> Path:
    """The figure of a run, which is made or finished first."""
    setup, changes, drawing = PICTURES[name]
    figure = run / "last_state.png"
    if not figure.exists():
        settings = [f"--set={change}" for change in changes]
        discsim("run", HOME / f"setups/{setup}.toml", "-o", run, *settings, *(["--resume"] if run.exists() else []))
    if drawing:
        figure = run / f"{drawing[0]}.png"
        discsim(drawing[0], run, *drawing[1:], "-o", figure)
    return figure


def discsim(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "discsim", *map(str, words)], check=True)


def store(figure: Path, path: Path) -> None:
    """Write a figure with all its colours and its texts, as small as PNG makes it."""
    with Image.open(figure) as image:
        texts = PngImagePlugin.PngInfo()
        for key, text in image.info.items():
            if isinstance(text, str):
                texts.add_text(key, text)
        image.convert("RGB").save(path, optimize=True, pnginfo=texts)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
