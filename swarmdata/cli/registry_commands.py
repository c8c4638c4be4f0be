"""`swarmdata registry ...`: what is published, and whether it can be made again."""

from pathlib import Path
from typing import Annotated

import typer

Ids = Annotated[
    list[str] | None,
    typer.Option("--id", metavar="ID", help="such as coop_nav-medium-mini; may be repeated"),
]
Minis = Annotated[bool, typer.Option("--minis", help="only the datasets of 5 %")]
Cached = Annotated[
    bool,
    typer.Option("--cached", help="take what is in the cache, fully verified, do not build it"),
]
Workers = Annotated[int | None, typer.Option(min=1, help="processes; default one per core")]

registry_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, check and renew what is published of the datasets.",
)


@registry_app.command("list")
def list_command() -> None:
    """Show every recipe and what is published of it."""
    from swarmdata.behavior_policies.tiers import shipped_recipes
    from swarmdata.registry.published import published

    line = "{:38} {:>12} {:>9} {:>8} {:>8} {:>8}  {:12}  {:12}  {}"
    head = ("id", "joint steps", "MB", "return", "success", "clean", "digest", "transport", "")
    typer.echo(line.format(*head).rstrip())
    known, recipes = published(), shipped_recipes()
    for key in sorted(known.keys() | recipes.keys()):
        entry = known.get(key)
        if entry is None:
            typer.echo(f"{key:38} not published")
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
    ids: Ids = None, minis: Minis = False, cached: Cached = False, workers: Workers = None
) -> None:
    """Make published datasets again and report every difference; exit code 1 if there is any.

    One at a time, beside the cache, and removed at once; each is named when it is done. After an
    interruption, go on with --id.
    """
    from swarmdata.hub.publishing.regenerate import check as check_all
    from swarmdata.hub.publishing.regenerate import published_ids, report

    chosen = published_ids(ids or (), minis=minis)
    checks = []
    for each in check_all(chosen, cached=cached, workers=workers):
        checks.append(each)
        n = len(each.differences)
        typer.echo(f"{each.dataset}: {f'{n} differences' if n else 'as published'}")
    typer.echo(report(checks), nl=False)
    if any(each.differences for each in checks):
        raise typer.Exit(1)


@registry_app.command()
def update(
    ids: Annotated[
        list[str], typer.Option("--id", metavar="ID", help="of a recipe; may be repeated")
    ],
    out: Annotated[
        Path, typer.Option(help="the JSON file; each id is put there once it is made")
    ] = Path("cards/published.json"),
    cached: Cached = False,
    workers: Workers = None,
) -> None:
    """Make datasets and publish what they are: digests, sizes and figures."""
    from swarmdata.behavior_policies.tiers import find_recipe
    from swarmdata.hub.publishing.regenerate import make_again, put_entries

    for recipe in [find_recipe(name) for name in ids]:
        entry = make_again(recipe, cached=cached, workers=workers)
        put_entries(out, {recipe.id: entry.model_dump(mode="json")})
        typer.echo(f"{recipe.id}: {entry.n_steps:,} joint steps, digest {entry.digest}")
