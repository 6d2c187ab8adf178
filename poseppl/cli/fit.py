"""The command `poseppl fit`: the parameters of one's own model from one's own data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import check_code, check_inputs
from poseppl.cli.options import common_options, seed_option
from poseppl.cli.run import fill_gaps_option, series_options, table_options
from poseppl.cli.settings import CommandWithSettings, assignments_option, check_algorithm

EXAMPLES = """
\b
Examples:
  poseppl fit model.py --data series.csv
      Maximum likelihood with standard errors, by a Kalman or a hidden Markov filter.
  poseppl fit model.py:trend --data series.csv --inputs push --method nuts --set num_draws=1000
      Posterior draws; a setting of the method.
  poseppl fit model.py --data series.csv --method pmmh --filter-set num_particles=500
      Posterior draws by a particle filter, and a setting of it.
  poseppl run model.py --data series.csv --filter kalman --fit poseppl-series-ml.nc
      A run with the estimates.

\b
The model: a file of NumPyro programs, parameters among them (docs/fitting.md); it is run, as any script of yours.
The data: one row a frame, as poseppl run has them.

\b
Files written:
  poseppl-NAME-METHOD.nc    estimates, standard errors and draws, for ArviZ and poseppl run --fit; NAME is that of the data

\b
Exit status: 0 done, 1 bad input or a fit that cannot go on, 2 wrong usage, 130 Ctrl-C.
"""


class _Fit(CommandWithSettings):
    kind = "method"


@click.command(cls=_Fit, epilog=EXAMPLES, short_help="Estimate the parameters of your own model.")
@click.argument("model")
@table_options
@series_options
@click.option(
    "--method",
    metavar="NAME",
    default="ml",
    show_default=True,
    help="ml, map, svi, nuts or others; poseppl methods lists them.",
)
@assignments_option(
    "--set", "settings", "A setting of the method; may be given several times. poseppl methods NAME lists them."
)
@click.option(
    "--filter",
    "filter_name",
    metavar="NAME",
    help="Filter of the likelihood. [default: hidden-markov or kalman, whichever takes the model; particle for pmmh and smc2]",
)
@assignments_option("--filter-set", "filter_settings", "A setting of the filter; poseppl filters NAME lists them.")
@assignments_option(
    "--start", "start", "Parameter to start from, NAME=NUMBER or NAME[0]=NUMBER; all or none. [default: draws of the prior]"
)
@fill_gaps_option
@seed_option()
@click.option(
    "--output", "-o", metavar="DIR|FILE.nc", help="File or folder of the result. [default: poseppl-NAME-METHOD.nc, here]"
)
@click.option("--json", "as_json", is_flag=True, help="Print the estimates as JSON instead of a table.")
@common_options
def fit(model: str, data: str, **options: Any) -> None:
    """Estimate the parameters of the state-space model in MODEL, FILE.py[:NAME] or package.module[:NAME], from a table."""
    from poseppl.cli.checks import check_writable, output_path
    from poseppl.cli.console import ConsoleProgress, print_finding, print_table, start_jax

    check_code(model.partition(":")[0], "MODEL")
    check_algorithm("method", options["method"], options["settings"])
    if options["filter_name"]:
        check_algorithm("filter", options["filter_name"], options["filter_settings"])
    check_inputs()
    target = output_path(options["output"], f"poseppl-{Path(data).stem}-{options['method']}", ".nc")
    check_writable([target], [data])

    from poseppl.cli.model_fits import HEAD, described, fitted, rows_of, worded_findings
    from poseppl.cli.outputs import keep_result

    quiet = options["quiet"] or options["as_json"]
    progress = ConsoleProgress(quiet, "fitting", "steps")
    start_jax()
    with progress.running():
        tree = fitted(model, data, options, progress)
        keep_result(tree, target)
    findings = worded_findings(tree)
    if options["as_json"]:
        click.echo(json.dumps(described(tree, target), indent=2))
    elif not quiet:
        about = {name: value for name, value in described(tree, target).items() if name not in ("parameters", "verdicts")}
        print_table(
            "poseppl fit", [(name, f"{value:.6g}" if isinstance(value, float) else str(value)) for name, value in about.items()]
        )
        print_table("", rows_of(tree), HEAD)
        if not findings:
            print_finding("info", "No problem detected.", quiet)
    for severity, text in () if options["as_json"] else findings:
        print_finding(severity, text, quiet)
