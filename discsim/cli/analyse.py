"""The command `analyse`, which runs the analysis scripts that come with discsim.

Each script in `analysis/` is complete: it has its options and its help, runs by itself, and can be copied and changed.
It is imported by its command only.
"""

from __future__ import annotations

from collections.abc import Callable

import typer

from discsim import shipped
from discsim.cli.base import INTERRUPTED, app, fail

# Command -> name of the script, and help in the list of commands.
SCRIPTS = {
    "gap": ("gap", "Gap of a companion: depth, and dust rings."),
    "torque": ("torque", "Torque on a companion, its error, theory."),
    "clumps": ("clumps", "Spiral modes and clumps."),
    "stress": ("stress", "Stress (alpha) of a self-gravitating disc."),
    "oneway-twoway": ("oneway_twoway", "Dust of two or more runs side by side."),
}

analyse = typer.Typer(
    rich_markup_mode=None, no_args_is_help=True, help="Measure results of runs; each measurement has a --help."
)
app.add_typer(analyse, name="analyse")


def _command(name: str, script: str) -> Callable[[typer.Context], None]:
    """Return the function of a command, which leaves all arguments to the script."""

    def run(ctx: typer.Context) -> None:
        try:
            status = shipped.analysis_script(script).main(ctx.args, prog=f"discsim analyse {name}")
        except KeyboardInterrupt:
            fail("interrupted", INTERRUPTED)
        raise SystemExit(status)

    return run


for _name, (_script, _help) in SCRIPTS.items():
    _settings = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
    analyse.command(_name, help=_help, context_settings=_settings, add_help_option=False)(_command(_name, _script))
