"""The command that ranks trained policies without a simulator."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.task_commands import setting

Runs = Annotated[list[Path], typer.Argument(metavar="RUN...", help="offline runs of one dataset")]
Out = Annotated[Path | None, typer.Option(help="folder for ranking.md, ranking.csv, ranking.json")]
DatasetId = Annotated[str | None, typer.Option(help="id or folder, if not the id the runs name")]
By = Annotated[str, typer.Option(help="fqe, imitation_error, weighted_imitation_error or td_error")]
Checkpoints = Annotated[bool, typer.Option(help="all that `train --keep` kept, not only the last")]
Episodes = Annotated[
    int | None, typer.Option(min=1, help="simulate so many, to see how well the criteria rank")
]
Results = Annotated[
    Path | None, typer.Option(help="the same from a folder that `evaluate --out` filled")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="of fitted Q evaluation, such as discount"),
]


def rank(
    runs: Runs,
    out: Out = None,
    dataset: DatasetId = None,
    by: By = "fqe",
    checkpoints: Checkpoints = False,
    episodes: Episodes = None,
    results: Results = None,
    settings: Settings = None,
    device: Annotated[str, typer.Option(help="of torch")] = "cpu",
) -> None:
    """Rank trained policies on the validation split: fitted Q evaluation, imitation and TD errors.

    No simulator is needed. With --episodes or --results, scores tell how far to trust the criteria.
    """
    from swarmdata.errors import UnknownNameError
    from swarmdata.evaluation.policy_selection.ranking_record import CRITERIA
    from swarmdata.evaluation.results.policy_names import require

    require("torch", "torch", "ranking policies")
    from swarmdata.evaluation.policy_selection import rank
    from swarmdata.learn.evaluation.fqe import FQEConfig
    from swarmdata.learn.training.overrides import override

    criterion = next((name for name in CRITERIA if name == by), None)
    if criterion is None:
        raise UnknownNameError("criterion", by, CRITERIA)
    ranking = rank.rank(
        runs,
        dataset_id=dataset,
        config=override(FQEConfig(), dict(map(setting, settings or []))),
        by=criterion,
        checkpoints=checkpoints,
        n_episodes=episodes,
        results=results,
        device=device,
    )
    if out is not None:
        ranking.write(out)
    typer.echo(ranking.to_text(), nl=False)
