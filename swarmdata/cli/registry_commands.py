"""`swarmdata registry ...`: published digests and figures; `swarmdata warm`: compiled kernels."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse_workers
from swarmdata.cli.shared_options import Engine, Workers

Cached = Annotated[
    bool, typer.Option("--cached", help="verify the datasets in the cache instead of building them")
]

registry_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, check and update the published digests and figures.",
)


@registry_app.command("list")
def list_command() -> None:
    """List all recipes with their published figures and digests."""
    from swarmdata.registry.published import published
    from swarmdata.registry.recipes import shipped_recipes

    known, recipes = published(), shipped_recipes()
    keys = sorted(known.keys() | recipes.keys())
    width = max(map(len, keys))
    line = f"{{:{width}}} {{:>12}} {{:>9}} {{:>8}} {{:>8}} {{:>8}}  {{:12}}  {{:12}}  {{}}"
    head = ("id", "joint steps", "MB", "return", "success", "clean", "digest", "transport", "")
    typer.echo(line.format(*head).rstrip())
    for key in keys:
        entry = known.get(key)
        if entry is None:
            typer.echo(f"{key:{width}} not published")
            continue
        current = key in recipes and recipes[key].hash() == entry.recipe_hash
        row = (
            key,
            f"{entry.n_steps:,}",
            f"{entry.n_bytes / 1e6:.1f}",
            f"{entry.mean_return:.2f}",
            f"{100 * entry.success:.1f} %",
            f"{100 * entry.clean_success:.1f} %",
            entry.digest[:12],
            entry.transport_digest[:12],
            "" if current else "of another recipe",
        )
        typer.echo(line.format(*row).rstrip())


@registry_app.command()
def check(
    context: typer.Context,
    ids: Annotated[
        list[str] | None,
        typer.Option(
            "--id", metavar="ID", help="dataset id, such as coop_nav-medium-mini; may be repeated"
        ),
    ] = None,
    minis: Annotated[bool, typer.Option("--minis", help="only the minis, datasets of 5 %")] = False,
    cached: Cached = False,
    workers: Workers = None,
    engine: Engine = "local",
) -> None:
    """Rebuild published datasets and report all differences.

    Datasets are built one at a time, outside the cache, and deleted after the comparison. The exit
    code is 1 if any of them differs or cannot be made. After an interruption, pass the remaining
    ids with --id.
    """
    refuse_workers(context, engine)
    from swarmdata.hub.publishing.regenerate import check as check_all
    from swarmdata.hub.publishing.regenerate import published_ids, report
    from swarmdata.runtime.batches import Failures

    chosen = published_ids(ids or (), minis=minis)
    checks, failures = [], Failures(len(chosen))
    for each in check_all(chosen, failures, cached=cached, workers=workers, engine=engine):
        checks.append(each)
        n = len(each.differences)
        typer.echo(f"{each.dataset}: {f'{n} differences' if n else 'as published'}")
    typer.echo(report(checks), nl=False)
    failures.check("datasets")
    if any(each.differences for each in checks):
        raise typer.Exit(1)


@registry_app.command()
def update(
    context: typer.Context,
    ids: Annotated[
        list[str], typer.Option("--id", metavar="ID", help="id of a recipe; may be repeated")
    ],
    out: Annotated[Path, typer.Option(help="JSON file to update after each dataset")] = Path(
        "cards/published.json"
    ),
    cached: Cached = False,
    workers: Workers = None,
    engine: Engine = "local",
) -> None:
    """Build datasets and publish their digests, sizes and figures."""
    refuse_workers(context, engine)
    from swarmdata.hub.publishing.regenerate import make_again, put_entries
    from swarmdata.registry.recipes import find_recipe
    from swarmdata.runtime.batches import Failures

    failures = Failures(len(ids))
    for recipe in [find_recipe(name) for name in ids]:
        with failures.item(recipe.id):
            entry = make_again(recipe, cached=cached, workers=workers, engine=engine)
            put_entries(out, {recipe.id: asdict(entry)})
            typer.echo(f"{recipe.id}: {entry.n_steps:,} joint steps, digest {entry.digest}")
    failures.check("datasets")


def warm(workers: Workers = None) -> None:
    """Compile all simulators now, so that no later command waits.

    Meant for images and CI. Kernels are kept in SWARMDATA_CACHE, or NUMBA_CACHE_DIR if it is set,
    and are good for this version of swarmdata and numba and for this kind of CPU.
    """
    from swarmdata.building.kernel_warmup import kernel_folder, warm_kernels

    n_compiled = warm_kernels(workers=workers)
    typer.echo(f"{kernel_folder()}: {n_compiled} kernels compiled, none is left to do")
