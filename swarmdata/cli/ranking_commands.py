"""`swarmdata rank`: ranks trained policies without a simulator."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.shared_options import Settings, parse_settings

Runs = Annotated[
    list[Path], typer.Argument(metavar="RUN...", help="folders of offline runs on one dataset")
]
Out = Annotated[Path | None, typer.Option(help="folder for ranking.md, ranking.csv, ranking.json")]
DatasetId = Annotated[
    str | None, typer.Option(help="dataset id or folder, if not the id that the runs name")
]
By = Annotated[
    str, typer.Option(help="criterion: fqe, imitation_error, weighted_imitation_error or td_error")
]
Checkpoints = Annotated[
    bool, typer.Option(help="rank all checkpoints kept by `train --keep`, not only the last")
]
Episodes = Annotated[
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
    out: Out = None,
    dataset: DatasetId = None,
    by: By = "fqe",
    checkpoints: Checkpoints = False,
    episodes: Episodes = None,
    results: Results = None,
    settings: Settings = None,
    device: Annotated[str, typer.Option(help="torch device")] = "cpu",
) -> None:
    """Rank trained policies on the validation split.

    The criteria need no simulator: fitted Q evaluation (whose settings --set changes), imitation
    errors and TD errors. With --episodes or --results, the report also says how well each criterion
    agrees with simulated scores.
    """
    from swarmdata.errors import UnknownNameError
    from swarmdata.evaluation.policy_selection.ranking_record import CRITERIA, RANKING
    from swarmdata.runtime.extras import require_extra
    from swarmdata.runtime.output_folder import check_output

    require_extra("torch", "torch", "ranking policies")
    from swarmdata.evaluation.policy_selection import rank
    from swarmdata.learn.evaluation.fqe import FQEConfig
    from swarmdata.learn.training.overrides import override

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
