"""The commands about scenes: `check`, `setups`, `new` and `effects`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import NOT_WRITTEN, SceneArgument, SetOption, WithoutOption, app, fail, load, show
from discsim.shipped import ShippedError, copy_setup
from discsim.shipped import setups as shipped_setups
from discsim.userfiles import system_message


@app.command()
def check(scene: SceneArgument, settings: SetOption = None, without: WithoutOption = None) -> None:
    """Validate a scene: its effects, derived numbers, warnings."""
    loaded = load(scene, settings or (), without or ())
    from discsim.preview.check import report

    show(report(loaded))


@app.command()
def setups() -> None:
    """List the setups that come with discsim. Each has its name, title, subject and duration."""
    for each in shipped_setups().values():
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
    try:
        copy_setup(name, path)
    except ShippedError as error:
        fail(str(error))
    except OSError as error:
        fail(system_message(error, "written", path), NOT_WRITTEN)
    show(f"{path}: copy of the setup {name}; run it with: discsim run {path}")


@app.command()
def effects(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One table, like drag or run [all].")] = None,
) -> None:
    """List the effects: equations, and keys with units and defaults."""
    from discsim.preview.reference import effects_text
    from discsim.printable import UserError

    try:
        show(effects_text(name))
    except UserError as wrong:
        fail(str(wrong))
