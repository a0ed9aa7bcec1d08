"""The command `cost`: errors against CPU time, and the search for the cheapest settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import SceneArgument, SetOption, VaryOption, WithoutOption, app, exit_on_fault, fail, load
from discsim.printable import printable
from discsim.run.directory import locked_directory, require_usable_directory

ERROR_NOT_REACHED = 4

ReferenceOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TABLE.KEY=VALUE",
        help="Key and value of the reference run, for scenes without an exact solution [2 x particles].",
    ),
]


@app.command()
def cost(
    scene: SceneArgument,
    error: Annotated[
        str | None,
        typer.Option(
            metavar="E", help='Find the cheapest setting with this error: "1%", or "scene" for the error of the scene.'
        ),
    ] = None,
    vary: VaryOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Directory of the table and figure [runs/<name>-cost]."),
    ] = None,
    budget: Annotated[str, typer.Option(metavar="T", help="Wall-clock limit of a search, with compilation.")] = "1 h",
    measure: Annotated[
        str | None, typer.Option(metavar="NAME", help="Error measure, like exact, dust-profile, gas-modes.")
    ] = None,
    reference: ReferenceOption = None,
    keep: Annotated[
        list[str] | None, typer.Option(metavar="TABLE.KEY", help="Key that a search does not change.")
    ] = None,
    repeat: Annotated[
        int | None, typer.Option(min=1, help="Number of runs of each setting [1], or of each finalist of a search [3].")
    ] = None,
    parallel: Annotated[int, typer.Option(min=1, help="Number of simultaneous runs, which slow each other down.")] = 1,
    settings: SetOption = None,
    without: WithoutOption = None,
) -> None:
    """Measure what accuracy costs, or find the cheapest setting.

    --vary makes a table of runs, --error finds the setting.
    """
    changed = settings or (), without or ()
    loaded = load(scene, *changed)
    directory = output or Path("runs") / f"{scene.stem}-{'cost' if error is None else 'cheapest'}"
    title = loaded.title or printable(scene)
    again = f"interrupted; repeat the command to continue with the runs in {directory}"
    with exit_on_fault("read or written", directory, again):
        from discsim.study.points import Varied

        varied = [Varied.from_text(text) for text in vary or ()]
        make: Callable[[], bool]
        if error is None:
            _refuse_search_options(vary, {"--measure": measure, "--reference": reference, "--keep": keep})
            from discsim.study.cost import Study

            make = partial(Study(scene, varied, repeat or 1, directory, *changed).make, title, parallel)
        else:
            from discsim.study.cheapest import Cheapest, SearchOptions, parse_budget, parse_error, parse_reference

            finer = parse_reference(reference or ())
            goal, seconds = parse_error(error), parse_budget(budget)
            options = SearchOptions(goal, seconds, measure, finer, varied, keep or (), repeat or 3, parallel)
            make = partial(Cheapest(scene, directory, options, *changed).make, title)
        require_usable_directory(directory, resume=False)
        with locked_directory(directory):
            reached = make()
    if not reached:
        raise SystemExit(ERROR_NOT_REACHED)


def _refuse_search_options(vary: list[str] | None, given: Mapping[str, object]) -> None:
    """Exit with a message if the command has no --vary, or has options that only a search uses.

    given: values of the options that only a search uses, by name.
    """
    if not vary:
        fail("nothing to do; add --error 1% to find the cheapest setting, or --vary with values of a key")
    for name, value in given.items():
        if value:
            fail(f"{name}: used only with --error; add --error, or remove {name}")
