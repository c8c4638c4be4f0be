"""The commands that evaluate policies, and that make tables and figures of the results."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.task_commands import Communication, Observation


def evaluate(
    targets: Annotated[
        list[str],
        typer.Argument(metavar="TARGET...", help="policies, tiers, dataset ids or run folders"),
    ],
    episodes: Annotated[int, typer.Option(min=1, help="reserved evaluation seeds to use")] = 1000,
    out: Annotated[Path | None, typer.Option(help="folder for the results")] = None,
    task: Annotated[
        str, typer.Option(help="of policies and tiers: a preset, or a spec's file")
    ] = "coop_nav",
    label: Annotated[
        str | None,
        typer.Option(help="row of the targets in tables", show_default="the target's name"),
    ] = None,
    again: Annotated[bool, typer.Option(help="measure what is in the folder already")] = False,
    observation: Observation = None,
    communication: Communication = None,
) -> None:
    """Evaluate policies on the reserved seeds and print tables; run again to go on.

    What the folder has of the same policy, task, seeds and version is not measured again.
    """
    from swarmdata.evaluation.results.policy_names import evaluate_target, find_target
    from swarmdata.evaluation.results.report import shown_cases
    from swarmdata.evaluation.results.result_set import group_results
    from swarmdata.evaluation.results.result_tables import case_table

    found = [find_target(name, task, observation, communication) for name in targets]
    if label is not None:
        found = [target.labelled(label) for target in found]
    results = [
        result for target in found for result in evaluate_target(target, episodes, out, again=again)
    ]
    for case in shown_cases(group_results(results)).values():
        typer.echo(case_table(case).to_text(), nl=False)
    if kept := sum(result.path is not None for result in results):
        typer.echo(f"\n{kept} of {len(results)} were in {out} already; --again measures them anew.")


def report(
    results: Annotated[
        list[Path],
        typer.Argument(metavar="RESULTS...", help="folders that `evaluate --out` filled"),
    ],
    out: Annotated[Path, typer.Option(help="folder for tables and figures")],
    runs: Annotated[list[Path] | None, typer.Option(help="run folders to draw curves of")] = None,
    data: Annotated[
        list[Path] | None, typer.Option(help="folders of your own datasets, for their means")
    ] = None,
    figures: Annotated[str, typer.Option(help="png, svg or pdf")] = "png",
) -> None:
    """Write tables (Markdown, CSV, LaTeX, marl-eval JSON) and figures; refuse mixed results."""
    from swarmdata.evaluation.results.report import write_report

    text = write_report(results, out, runs=runs or [], data=data or [], suffix=f".{figures}")
    typer.echo(text, nl=False)
