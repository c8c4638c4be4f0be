"""`swarmdata filter | combine | subsample`: new datasets of episodes of others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset

Source = Annotated[str, typer.Argument(metavar="ID_OR_PATH", help="an id, or a dataset's folder")]
NewId = Annotated[str, typer.Option("--id", metavar="ID", help="of the new dataset: TASK-NAME-v0")]
Out = Annotated[Path | None, typer.Option(help="its folder; default in the cache")]
TierName = Annotated[str, typer.Option("--tier", help="of the new dataset")]
MinReturn = Annotated[float | None, typer.Option(help="least team return, included")]
MaxReturn = Annotated[float | None, typer.Option(help="greatest team return, included")]


def filter_command(
    source: Source,
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
    success: Annotated[
        bool | None, typer.Option("--success/--no-success", help="solved, or not")
    ] = None,
    min_return: MinReturn = None,
    max_return: MaxReturn = None,
    policy: Annotated[str | None, typer.Option(help="label of a policy")] = None,
    split: Annotated[str | None, typer.Option(help="train, validation or test")] = None,
    seeds: Annotated[
        list[int] | None, typer.Option("--seed", help="of an episode; may be repeated")
    ] = None,
    episodes: Annotated[
        list[int] | None, typer.Option("--episode", help="stored number; may be repeated")
    ] = None,
) -> None:
    """Make a dataset of the episodes that meet every condition."""
    from swarmdata.building.edit import filter_dataset

    made = filter_dataset(
        _open(source), _out(new_id, out), id=new_id, tier=tier, success=success,
        min_return=min_return, max_return=max_return, policy=policy, split=split,
        seeds=seeds, episodes=episodes,
    )  # fmt: skip
    _tell(made)


def combine_command(
    sources: Annotated[
        list[str], typer.Argument(metavar="ID_OR_PATH...", help="ids or datasets' folders")
    ],
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
) -> None:
    """Make a dataset of all episodes of several of one task."""
    from swarmdata.building.edit import combine_datasets

    opened = [_open(source) for source in sources]
    _tell(combine_datasets(opened, _out(new_id, out), id=new_id, tier=tier))


def subsample_command(
    source: Source,
    new_id: NewId,
    out: Out = None,
    tier: TierName = "edited",
    steps: Annotated[int | None, typer.Option(min=1, help="least joint steps")] = None,
    min_return: MinReturn = None,
    max_return: MaxReturn = None,
    like: Annotated[
        str | None, typer.Option(metavar="ID_OR_PATH", help="dataset whose returns to match")
    ] = None,
    bins: Annotated[int, typer.Option(min=1, help="with --like: bins of returns")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="of the choice")] = 0,
) -> None:
    """Make a smaller dataset: of a size, a range of returns, or with returns like another's."""
    from swarmdata.building.edit import subsample_dataset

    made = subsample_dataset(
        _open(source), _out(new_id, out), id=new_id, tier=tier, n_steps=steps,
        min_return=min_return, max_return=max_return,
        like=None if like is None else _open(like), bins=bins, seed=seed,
    )  # fmt: skip
    _tell(made)


def _open(source: str) -> "Dataset":
    from swarmdata.hub.catalog.catalog import load

    return load(source)


def _out(new_id: str, out: Path | None) -> Path:
    from swarmdata.store.cache import cache_folder

    return out or cache_folder() / "datasets" / new_id


def _tell(made: "Dataset") -> None:
    typer.echo(
        f"{made.path}\n{len(made):,} episodes, {made.n_steps:,} joint steps, digest {made.digest}"
    )
