"""`swarmdata filter | combine | subsample`: new datasets from the episodes of existing ones."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import IdOrPath, summary_of

NewId = Annotated[
    str, typer.Option("--id", metavar="ID", help="id of the new dataset: TASK-NAME-v0")
]
Out = Annotated[Path | None, typer.Option(help="folder of the new dataset; default: in the cache")]
TierName = Annotated[str, typer.Option("--tier", help="tier of the new dataset")]
MinReturn = Annotated[float | None, typer.Option(help="minimum team return, inclusive")]
MaxReturn = Annotated[float | None, typer.Option(help="maximum team return, inclusive")]


def filter_command(
    source: IdOrPath,
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
    success: Annotated[
        bool | None,
        typer.Option("--success/--no-success", help="only solved, or only unsolved episodes"),
    ] = None,
    min_return: MinReturn = None,
    max_return: MaxReturn = None,
    policy: Annotated[
        str | None, typer.Option(help="only episodes of the policy with this label")
    ] = None,
    split: Annotated[str | None, typer.Option(help="one split: train, validation or test")] = None,
    seeds: Annotated[
        list[int] | None, typer.Option("--seed", help="seed of an episode; may be repeated")
    ] = None,
    episodes: Annotated[
        list[int] | None, typer.Option("--episode", help="index of an episode; may be repeated")
    ] = None,
) -> None:
    """Make a dataset of the episodes that meet all conditions."""
    from swarmdata.building.edit import filter_dataset
    from swarmdata.hub.catalog.catalog import load

    made = filter_dataset(
        load(source), out, id=new_id, tier=tier, success=success,
        min_return=min_return, max_return=max_return, policy=policy, split=split,
        seeds=seeds, episodes=episodes,
    )  # fmt: skip
    typer.echo(summary_of(made))


def combine_command(
    sources: Annotated[
        list[str], typer.Argument(metavar="ID_OR_PATH...", help="dataset ids or folders")
    ],
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
) -> None:
    """Make a dataset of all episodes of several datasets."""
    from swarmdata.building.edit import combine_datasets
    from swarmdata.hub.catalog.catalog import load

    opened = [load(source) for source in sources]
    typer.echo(summary_of(combine_datasets(opened, out, id=new_id, tier=tier)))


def subsample_command(
    context: typer.Context,
    source: IdOrPath,
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
    steps: Annotated[int | None, typer.Option(min=1, help="minimum number of joint steps")] = None,
    min_return: MinReturn = None,
    max_return: MaxReturn = None,
    like: Annotated[
        str | None,
        typer.Option(metavar="ID_OR_PATH", help="dataset whose distribution of returns to match"),
    ] = None,
    bins: Annotated[
        int | None, typer.Option(min=1, help="with --like: bins of the return; default: 20")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="seed of the random choice")] = 0,
) -> None:
    """Make a smaller dataset by size or by return.

    Episodes are drawn at random, from a range of returns or to match another dataset's returns.
    """
    if like is None:
        refuse(context, ("bins",), "without --like")
    if like is None and steps is None:
        refuse(context, ("seed",), "without --steps or --like: nothing is drawn")
    from swarmdata.building.edit import subsample_dataset
    from swarmdata.hub.catalog.catalog import load

    made = subsample_dataset(
        load(source), out, id=new_id, tier=tier, n_steps=steps,
        min_return=min_return, max_return=max_return,
        like=None if like is None else load(like), bins=bins, seed=seed,
    )  # fmt: skip
    typer.echo(summary_of(made))
