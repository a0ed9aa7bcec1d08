"""The commands about scenes: `check`, `setups`, `new` and `effects`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from discsim import shipped
from discsim.cli.base import SceneArgument, SetOption, WithoutOption, app, exit_on_fault, load, show


@app.command()
def check(scene: SceneArgument, settings: SetOption = None, without: WithoutOption = None) -> None:
    """Validate a scene: its effects, derived numbers, warnings."""
    loaded = load(scene, settings or (), without or ())
    from discsim.preview.check import report

    show(report(loaded))


@app.command()
def setups() -> None:
    """List the setups that come with discsim. Each has its name, title, subject and duration."""
    for each in shipped.setups().values():
        takes = each.notes.get("How long", "").partition(",")[0].rstrip(".")
        show(f"{each.name:<18} {each.title}{f' ({takes})' if takes else ''}\n{'':<18} {each.about}".rstrip())


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of a setup from `discsim setups`.")],
    file: Annotated[
        Path | None, typer.Argument(help="New scene file [NAME.toml].", metavar="[FILE.toml]", readable=False)
    ] = None,
) -> None:
    """Copy a setup, as the start of a scene of your own."""
    path = file or Path(f"{name}.toml")
    with exit_on_fault("written", path, "interrupted"):
        shipped.copy_setup(name, path)
    show(f"{path}: copy of the setup {name}; run it with: discsim run {path}")


@app.command()
def effects(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One table, like drag or run [all].")] = None,
) -> None:
    """List the effects: equations, and keys with units and defaults."""
    from discsim.preview.reference import effects_text

    show(effects_text(name))
