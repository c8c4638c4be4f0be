"""`swarmdata task ...`: shows, checks and plays task specs."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import Backend, Clip, Communication, Observation

NameOrFile = Annotated[
    str, typer.Argument(metavar="NAME_OR_FILE", help="preset, or a YAML or JSON file with a spec")
]

task_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, check and play tasks: presets, or specs in files.",
)


@task_app.command("list")
def list_command() -> None:
    """List all presets."""
    from swarmdata.registry.presets import preset, preset_names, preset_summary

    longest = max(map(len, preset_names()))
    line = f"{{:{longest}}}  {{:12}} {{:>6}}  {{:>11}}  {{:>7}}  {{}}"
    typer.echo(line.format("name", "task", "robots", "arena (m)", "horizon", "summary"))
    for name in preset_names():
        spec = preset(name)
        arena = f"{spec.arena.width:g} x {spec.arena.height:g}"
        row = (name, spec.task, spec.n_agents, arena, spec.horizon, preset_summary(name))
        typer.echo(line.format(*row))


@task_app.command()
def show(
    name: NameOrFile, observation: Observation = None, communication: Communication = None
) -> None:
    """Print a task spec as YAML, including all defaults."""
    from swarmdata.registry.presets import find_spec
    from swarmdata.specs.model_choice import chosen_models

    spec = chosen_models(find_spec(name), observation, communication)
    typer.echo(spec.to_yaml(), nl=False)


@task_app.command()
def validate(name: NameOrFile) -> None:
    """Check a task spec and simulate a few steps of it.

    Reports all invalid keys and values at once with the allowed ones, then values that contradict
    each other, then problems of the world, such as obstacles that leave no room for robots.
    """
    from swarmdata.registry.presets import find_spec
    from swarmdata.rollouts.spec_check import probe
    from swarmdata.specs.budget import demand_of, describe_demand
    from swarmdata.specs.model_choice import describe

    spec = find_spec(name)
    env = probe(spec)
    typer.echo(
        f"OK: {spec.task} with {spec.n_agents} robots, {describe(spec)}; observation size "
        f"{env.observation_size}, action size {env.action_size} per robot; spec "
        f"{spec.hash()[:12]}; {describe_demand(demand_of(spec))}"
    )


@task_app.command(hidden=True)  # for maintainers
def table(out: Annotated[Path, typer.Option(help="folder to write the pages to")]) -> None:
    """Write the pages of reference results in all presets (docs/worlds)."""
    from swarmdata.cards.worlds_page import worlds_pages
    from swarmdata.registry.published import references
    from swarmdata.runtime.output_folder import OutputKind, filled

    with filled(out, OutputKind("table of worlds")) as folder:
        for name, text in worlds_pages(references()).items():
            (folder / name).write_text(text, encoding="utf-8")
    typer.echo(out)


@task_app.command()
def play(
    context: typer.Context,
    name: NameOrFile,
    out: Clip,
    policy: Annotated[str, typer.Option(help="policy, tier or run folder")] = "scripted",
    episode: Annotated[int, typer.Option(min=0, help="index of the evaluation seed")] = 0,
    observation: Observation = None,
    communication: Communication = None,
    backend: Backend = None,
    size: Annotated[int, typer.Option(min=64, help="pixels of the arena's longer side")] = 384,
    stride: Annotated[int, typer.Option(min=1, help="control steps per animation frame")] = 1,
) -> None:
    """Run a policy for one episode and draw it.

    Lidar rays and messages are drawn if the task has them.
    """
    if out.suffix.lower() == ".png":
        refuse(context, ("stride",), "with a .png, which has one frame")
    from swarmdata.evaluation.results.clips import draw_target
    from swarmdata.types import END_REASONS

    played = draw_target(
        policy, out, episode, name, observation, communication, backend, size=size, stride=stride
    )
    typer.echo(
        f"{out}: {len(played)} steps, ended by {END_REASONS[played.end_reason]}, return "
        f"{played.team_return:.2f}"
    )
