"""Steps that `discsim check` forecasts over those that runs take: a table of all setups and of published discs.

    python analysis/forecast_steps.py [SCENE ...] [--steps N] [--particles S]

Each run goes to its end, or for N steps, and the forecast is that of the same stretch of time. With --particles a
share S of the particles is run, and forecast: such runs see more of a scene's time for the same CPU time.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from discsim import Simulation, load_scene
from discsim.preview.forecast import Steps, expected_steps
from discsim.run.simulation import PhysicsError
from discsim.scene import Scene

ROOT = Path(__file__).parents[1]
SCENES = [*sorted((ROOT / "setups").glob("*.toml")), *sorted((ROOT / "tests/scenes_of_published_discs").glob("*.toml"))]
FEWEST = {"gas": 1500, "dust": 800}  # particles, of a share of them
WITHIN = 1.5


class Found(NamedTuple):
    """A run, or a stretch of it: its share of the time, its steps, and the effect that has set most of them."""

    share: float
    steps: int
    by: str
    expected: Steps

    @property
    def ratio(self) -> float:
        return self.expected.number / self.steps


def thinned(path: Path, share: float) -> Scene:
    """The scene with a share of its particles."""
    scene = load_scene(path)
    changes = []
    if share < 1.0:
        tables: list[tuple[str, str, Any]] = [("gas", "gas", scene.gas)] if scene.gas else []
        many = len(scene.dust or ()) > 1
        tables += [("dust", f"dust.{i}" if many else "dust", dust) for i, dust in enumerate(scene.dust or ())]
        for kind, table, keys in tables:
            changes.append(f"{table}.particles={min(keys.particles, max(FEWEST[kind], int(share * keys.particles)))}")
    return load_scene(path, changes)


def measure(scene: Scene, most: int | None = None) -> Found:
    """Run a scene to its end, or for so many steps."""
    sim, by = Simulation(scene), Counter[str]()

    def after_step() -> bool:
        by[sim.limited_by] += 1
        return sim.state.step == most

    sim.evolve(scene.run.until, after_step, read_only=True)
    share = sim.time / scene.run.until
    return Found(share, sim.state.step, by.most_common(1)[0][0], expected_steps(scene, sim.time))


def table(paths: Sequence[Path], most: int | None = None, share: float = 1.0) -> Iterator[str]:
    """Lines of the table in Markdown."""
    yield "| scene | share of the time | steps | forecast / run | set by, run | set by, forecast |"
    yield "| - | - | - | - | - | - |"
    ratios = []
    for path in paths:
        try:
            found = measure(thinned(path, share), most)
        except PhysicsError as fault:
            yield f"| {path.stem} | | | | {fault} | |"
            continue
        ratios.append(found.ratio)
        by = f"{found.expected.limiter} {found.expected.where}".rstrip()
        yield f"| {path.stem} | {found.share:.1%} | {found.steps} | {found.ratio:.2f} | {found.by} | {by} |"
    within = sum(1.0 / WITHIN <= ratio <= WITHIN for ratio in ratios)
    yield f"\nwithin a factor {WITHIN}: {within} of {len(paths)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", type=Path, default=SCENES, metavar="SCENE", help="[all of them]")
    parser.add_argument("--steps", type=int, metavar="N", help="of each run, at most [all]")
    parser.add_argument("--particles", type=float, default=1.0, metavar="S", help="share of the particles [1]")
    given = parser.parse_args()
    for line in table(given.scenes, given.steps, given.particles):
        print(line, flush=True)


if __name__ == "__main__":
    main()
