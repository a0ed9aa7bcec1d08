"""The setups that come with discsim."""

from pathlib import Path

SETUPS = sorted((Path(__file__).parents[2] / "setups").glob("*.toml"))
