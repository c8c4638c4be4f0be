"""`swarmdata evaluate` and `swarmdata report`: results of policies, their tables and figures."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import (
    Again,
    Communication,
    Episodes,
    Observation,
    Task,
    Validation,
)

Label = Annotated[
    str | None,
    typer.Option(help="name of the targets in tables", show_default="the target's name"),
]


def evaluate(
    context: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(metavar="TARGET...", help="policies, tiers, dataset ids or run folders"),
    ],
    episodes: Episodes = 1000,
    out: Annotated[Path | None, typer.Option(help="folder for result files")] = None,
    task: Task = None,
    label: Label = None,
    validation: Validation = False,
    again: Again = False,
    observation: Observation = None,
    communication: Communication = None,
) -> None:
    """Evaluate policies on the reserved seeds and print tables.

    An interrupted evaluation resumes: results in --out of the same policy, task, seeds and version
    are reused.
    """
    if out is None:
        refuse(context, ("again",), "without --out")
    from swarmdata.evaluation.results.policy_names import find_target
    from swarmdata.evaluation.results.report import shown_cases
    from swarmdata.evaluation.results.result_set import group_results
    from swarmdata.evaluation.results.result_tables import case_table
    from swarmdata.evaluation.results.target_evaluation import evaluate_target
    from swarmdata.numerics.random import SeedBlock

    found = [find_target(name, task, observation, communication) for name in targets]
    if label is not None:
        found = [target.labelled(label) for target in found]
    block: SeedBlock = "validation" if validation else "evaluation"
    results = [
        result
        for target in found
        for result in evaluate_target(target, episodes, out, block=block, again=again)
    ]
    for case in shown_cases(group_results(results)).values():
        typer.echo(case_table(case).to_text(), nl=False)
    if kept := sum(result.path is not None for result in results):
        typer.echo(
            f"\n{kept} of {len(results)} results were already in {out}; --again replaces them."
        )


def report(
    results: Annotated[
        list[Path],
        typer.Argument(metavar="RESULTS...", help="folders written by `swarmdata evaluate --out`"),
    ],
    out: Annotated[Path, typer.Option(help="folder for tables and figures")],
    runs: Annotated[
        list[Path] | None,
        typer.Option(help="run folder whose learning curve to draw; may be repeated"),
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(help="folder of an unpublished dataset, for its mean; may be repeated"),
    ] = None,
    figures: Annotated[str, typer.Option(help="format: png, svg or pdf")] = "png",
) -> None:
    """Write tables and figures of evaluation results.

    Tables are Markdown, CSV and LaTeX; there is also JSON for marl-eval. Stale results, and results
    that cannot be compared, are refused.
    """
    from swarmdata.evaluation.results.report import write_report

    text = write_report(results, out, runs=runs or [], data=data or [], suffix=f".{figures}")
    typer.echo(text, nl=False)
