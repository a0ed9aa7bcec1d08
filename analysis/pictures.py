"""Make the pictures of whole runs again: runs of setups, and figures of their ends in `analysis/figures`.

    python analysis/pictures.py first_disc dusty_disc -o OUT
    python analysis/pictures.py film_planet_dust -o OUT           a film of the gallery, with its last frame as a still

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
FILM_FOLDER = HOME / "docs" / "_static" / "films"
MAIN = ("gas.particles=6000", "dust.particles=10000", "space.cells=128", "run.until=700 yr")
PLANET, NEAR = ("gas.particles=15000", "dust.particles=10000"), ("--window", "1.8", "--dpi", "96")
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
    "plot_streamlines": ("planet_dust", PLANET, ("plot", "--field", "gas.v_r", "--streamlines", "companion", *NEAR)),
    "sky_image": ("dusty_disc", SKY, ("image", *SEEN, *BEAM)),
    "marks": ("planet_dust", (*GAP, "run.snapshots=15"), ("plot", *MARKS)),
    "planet_dust": ("planet_dust", (), ()),
    "planet_dust_grid": ("planet_dust_grid", (), ()),
    "planet_gap": ("planet_gap", (), ()),
    "planet_gap_grid": ("planet_gap_grid", (), ()),
    "planet_torque": ("planet_torque", (), ()),
    "gravitoturbulent": ("gravitoturbulent", (), ()),
    "cooling_fragments": ("cooling_fragments", (), ()),
}
# Films of the gallery, by "film_" and the setup: small runs, which take some minutes.
FILMS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "film_fragmenting_disc": (
        "fragmenting_disc",
        ("gas.particles=16000", "dust.particles=16000", "space.cells=256", "run.until=480 yr", "run.snapshots=72"),
        ("movie", "--field", "dust.surface_density", "--rate", "12"),
    ),
    "film_planet_dust": (
        "planet_dust",
        ("gas.particles=15000", "dust.particles=10000"),
        ("movie", "--field", "dust.surface_density", "--rate", "8"),
    ),
    "film_gravitoturbulent": (
        "gravitoturbulent",
        ("gas.particles=16000", "space.cells=192", "run.until=1600 yr", "run.snapshots=80"),
        ("movie", "--field", "gas.surface_density", "--rate", "12"),
    ),
    "film_streaming_clumps": (
        "streaming_clumps",
        ("gas.particles=8000", "dust.particles=30000", "run.until=100", "run.snapshots=50"),
        ("movie", "--field", "dust.surface_density", "--rate", "8"),
    ),
}

MADE = PICTURES | FILMS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=MADE, metavar="NAME", help=", ".join(MADE))
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="directory of the runs")
    parser.add_argument(
        "--into", type=Path, metavar="DIR", help=f"directory of the pictures [{FIGURES}, {FILM_FOLDER}]"
    )
    options = parser.parse_args()
    for name in options.names:
        found = drawn(name, options.output / name)
        if name in FILMS:
            store_film(found, (options.into or FILM_FOLDER) / f"{FILMS[name][0]}.mp4")
        else:
            store(found, (options.into or FIGURES) / f"{name}.png")


def drawn(name: str, run: Path) -> Path:
    """The figure of a run, which is made or finished first."""
    setup, changes, drawing = MADE[name]
    figure = run / "last_state.png"
    if not figure.exists():
        settings = [f"--set={change}" for change in changes]
        discsim("run", HOME / f"setups/{setup}.toml", "-o", run, *settings, *(["--resume"] if run.exists() else []))
    if drawing:
        figure = run / f"{drawing[0]}.{'mp4' if name in FILMS else 'png'}"
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


def store_film(film: Path, path: Path) -> None:
    """Write a film as small as a page needs it, ready to play while it loads, and its last frame as a still."""
    from imageio_ffmpeg import get_ffmpeg_exe

    encoder = [get_ffmpeg_exe(), "-y", "-loglevel", "error"]
    small = ["-c:v", "libx264", "-crf", "28", "-preset", "veryslow", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    still = path.with_suffix(".jpg")
    subprocess.run([*encoder, "-i", film, *small, path], check=True)
    subprocess.run([*encoder, "-sseof", "-0.2", "-i", film, "-update", "1", "-q:v", "3", still], check=True)
    for file in (path, still):
        print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
