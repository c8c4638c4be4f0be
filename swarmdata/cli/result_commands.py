"""`swarmdata evaluate | report | rank`: results of policies and runs, their tables and figures."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarmdata.cli.option_use import given, refuse, refuse_workers
from swarmdata.cli.shared_options import (
    Backend,
    Communication,
    Engine,
    Episodes,
    Observation,
    Part,
    Processes,
    Randomize,
    Settings,
    Task,
    Threads,
    Validation,
    parse_part,
    parse_ranges,
    parse_settings,
)
from swarmdata.errors import UnknownNameError

if TYPE_CHECKING:
    from swarmdata.evaluation.results.evaluation_jobs import Evaluation
    from swarmdata.evaluation.results.result_files import Result
    from swarmdata.numerics.random import SeedBlock


def evaluate(
    context: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="TARGET...",
            help="policies, tiers, datasets, run folders or zoo:ALGORITHM/DATASET",
        ),
    ],
    episodes: Episodes = 1000,
    out: Annotated[Path | None, typer.Option(help="folder for result files")] = None,
    task: Task = None,
    label: Annotated[
        str | None,
        typer.Option(help="name of the targets in tables", show_default="the target's name"),
    ] = None,
    validation: Validation = False,
    again: Annotated[
        bool, typer.Option(help="evaluate again, even if --out has the result")
    ] = False,
    observation: Observation = None,
    communication: Communication = None,
    backend: Backend = None,
    randomize: Randomize = None,
    side: Annotated[
        str | None, typer.Option(help="the side that policies play, in a task of several")
    ] = None,
    opponents: Annotated[
        str | None,
        typer.Option(help="who plays the other sides: a policy, a tier, or a run of another side"),
    ] = None,
    threads: Threads = 1,
    workers: Processes = 1,
    engine: Engine = "local",
    part: Part = None,
    collect: Annotated[
        bool, typer.Option("--collect", help="print what finished results give, and evaluate none")
    ] = False,
    budget: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COST=LIMIT",
            help="largest mean cost of an episode, such as robot_collisions=0.1; may be repeated",
        ),
    ] = None,
) -> None:
    """Evaluate policies on the reserved seeds and print tables.

    An interrupted evaluation resumes: results in --out of the same policy, task, seeds and version
    are reused. Several processes or machines leave their results in --out.
    """
    _check_options(context, engine, part, has_folder=out is not None, collect=collect)
    from swarmdata.evaluation.results.evaluation_jobs import (
        TargetName,
        check_different,
        evaluations_of,
        run_evaluations,
    )
    from swarmdata.evaluation.results.target_evaluation import evaluate_target

    how = {
        "task": task, "observation": observation, "communication": communication, "label": label,
        "backend": backend, "randomization": parse_ranges(randomize),
        "side": side, "opponents": opponents,
    }  # fmt: skip
    sources = [TargetName.parse({"name": name, **how}) for name in targets]
    found = [(source, source.find()) for source in sources]
    check_different([target for _, target in found])
    block: SeedBlock = "validation" if validation else "evaluation"
    budgets = parse_budgets(budget)
    if out is None:
        results = []
        for _, target in found:
            results += evaluate_target(target, episodes, block=block, n_threads=threads)
        _print_tables(results, budgets)
        return
    every = [each for one in found for each in evaluations_of(*one, episodes, out, block=block)]
    options: dict[str, Any] = {"again": again, "n_threads": threads}
    if part is not None:
        k, n = parse_part(part)
        chosen = every[k - 1 :: n]
        n_kept = run_evaluations(chosen, **options) if chosen else 0
        typer.echo(f"{len(chosen) - n_kept} of {len(every)} results made in {out}")
    else:
        options |= {"engine": engine, "workers": workers}
        _run_all(every, out, options, budgets, is_run=not collect)


def parse_budgets(texts: list[str] | None) -> dict[str, float]:
    """Reads all `--budget` options."""
    from swarmdata.numerics.event_costs import COSTS

    budgets = {}
    for name, text in parse_settings(texts, "--budget").items():
        if name not in COSTS:
            raise UnknownNameError("cost", name, COSTS)
        try:
            budgets[name] = float(text)
        except ValueError:
            budgets[name] = math.nan
        if not 0.0 <= budgets[name] < math.inf:
            message = f"got {name}={text}, expected a number of at least 0 after the sign"
            raise typer.BadParameter(message, param_hint="--budget")
    return budgets


def _run_all(
    every: "Sequence[Evaluation]",
    out: Path,
    options: Mapping[str, Any],
    budgets: Mapping[str, float],
    *,
    is_run: bool,
) -> None:
    """Makes the results that are not there, unless they are only collected, and prints tables."""
    from swarmdata.evaluation.results.evaluation_jobs import collect_evaluations, run_evaluations

    n_kept = run_evaluations(every, **options) if is_run else 0
    _print_tables(collect_evaluations(every), budgets)
    if n_kept:
        typer.echo(
            f"\n{n_kept} of {len(every)} results were already in {out}; --again replaces them."
        )


def _check_options(
    context: typer.Context, engine: str, part: str | None, *, has_folder: bool, collect: bool
) -> None:
    """Refuses options that have no effect beside the others."""
    refuse_workers(context, engine)
    if not has_folder:
        refuse(context, ("again", "part", "collect"), "without --out")
        for name in ("workers", "engine"):
            if given(context, name):
                raise typer.BadParameter(
                    "needs --out FOLDER, where all processes leave results", param_hint=f"--{name}"
                )
    if part is not None:
        refuse(context, ("workers", "engine", "collect", "budget"), "with --part")
    elif collect:
        refuse(context, ("workers", "engine", "again", "threads"), "with --collect")


def _print_tables(results: "list[Result]", budgets: Mapping[str, float]) -> None:
    from swarmdata.evaluation.results.report import shown_cases
    from swarmdata.evaluation.results.result_set import group_results
    from swarmdata.evaluation.results.result_tables import budget_table, case_table

    for case in shown_cases(group_results(results)).values():
        typer.echo(case_table(case).to_text(), nl=False)
        if budgets:
            typer.echo(budget_table(case, budgets).to_text(), nl=False)


def report(
    context: typer.Context,
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="RESULTS|RUN...", help="folders of `evaluate --out`, and of runs"),
    ],
    out: Annotated[Path, typer.Option(help="folder for tables and figures")],
    data: Annotated[
        list[Path] | None,
        typer.Option(help="folder of an unpublished dataset, for its mean; may be repeated"),
    ] = None,
    figures: Annotated[str, typer.Option(help="format: png, svg or pdf")] = "png",
) -> None:
    """Write tables and figures of results and runs.

    Tables are Markdown, CSV and LaTeX; there is also JSON for marl-eval. Of offline runs beside
    results, the learning curves are drawn. Online runs alone give a table of what they achieved and
    cost, and their curves. Stale results, and results that cannot be compared, are refused.
    """
    from swarmdata.learn.training.run_files import run_folders

    runs = [source for source in sources if run_folders(source)]
    results = [source for source in sources if source not in runs]
    if results:
        from swarmdata.evaluation.results.report import write_report

        text = write_report(results, out, runs=runs, data=data or [], suffix=f".{figures}")
    else:
        refuse(context, ("data",), "without results")
        from swarmdata.runtime.extras import require_extra

        require_extra("torch", "torch", "reading online runs")
        from swarmdata.evaluation.results.online_report import write_online_report

        text = write_online_report(runs, out, suffix=f".{figures}")
    typer.echo(text, nl=False)


Runs = Annotated[
    list[Path], typer.Argument(metavar="RUN...", help="folders of offline runs on one dataset")
]
RankingOut = Annotated[
    Path | None, typer.Option(help="folder for ranking.md, ranking.csv, ranking.json")
]
DatasetId = Annotated[
    str | None, typer.Option(help="dataset id or folder, if not the id that the runs name")
]
By = Annotated[
    str,
    typer.Option(
        help="criterion: fqe, fqe_pessimistic, imitation_error, weighted_imitation_error, td_error"
    ),
]
Checkpoints = Annotated[
    bool, typer.Option(help="rank all checkpoints kept by `train --keep`, not only the last")
]
Simulated = Annotated[
    int | None,
    typer.Option(
        min=1, help="also simulate this many episodes, to measure how well the criteria rank"
    ),
]
Results = Annotated[
    Path | None, typer.Option(help="the same with the results of `swarmdata evaluate --out`")
]


def rank(
    runs: Runs,
    out: RankingOut = None,
    dataset: DatasetId = None,
    by: By = "fqe",
    checkpoints: Checkpoints = False,
    episodes: Simulated = None,
    results: Results = None,
    settings: Settings = None,
    device: Annotated[str, typer.Option(help="torch device")] = "cpu",
) -> None:
    """Rank trained policies on the validation split.

    The criteria need no simulator: fitted Q evaluation (whose settings --set changes), imitation
    errors and TD errors. With --episodes or --results, the report also says how well each criterion
    agrees with simulated scores.
    """
    from swarmdata.evaluation.policy_selection.ranking_record import CRITERIA, RANKING
    from swarmdata.runtime.extras import require_extra
    from swarmdata.runtime.output_folder import check_output

    require_extra("torch", "torch", "ranking policies")
    from swarmdata.evaluation.policy_selection import rank
    from swarmdata.learn.evaluation.fqe import FQEConfig
    from swarmdata.learn.training.settings import override

    criterion = next((name for name in CRITERIA if name == by), None)
    if criterion is None:
        raise UnknownNameError("criterion", by, CRITERIA)
    if out is not None:
        check_output(out, RANKING)
    ranking = rank.rank(
        runs,
        dataset_id=dataset,
        config=override(FQEConfig(), parse_settings(settings)),
        by=criterion,
        checkpoints=checkpoints,
        n_episodes=episodes,
        results=results,
        device=device,
    )
    if out is not None:
        ranking.write(out)
    typer.echo(ranking.to_text(), nl=False)
