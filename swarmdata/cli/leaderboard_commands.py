"""`swarmdata leaderboard`: entries of trained policies, which anybody can verify."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.shared_options import Threads

leaderboard_app = typer.Typer(
    no_args_is_help=True, help="Make and verify entries of a leaderboard."
)


@leaderboard_app.command("submit")
def submit_command(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="run folders, or files of ONNX")
    ],
    dataset: Annotated[str, typer.Option(help="published dataset that they were trained on")],
    name: Annotated[str, typer.Option(help="name of the entry's row")],
    license: Annotated[str, typer.Option(help="of the policies, such as Apache-2.0")],
    code: Annotated[str, typer.Option(help="address of the training's code")],
    trials: Annotated[int, typer.Option(min=1, help="configurations that were tried")],
    tuning_episodes: Annotated[
        int, typer.Option(min=0, help="simulated episodes that settings were chosen on")
    ],
    out: Annotated[Path, typer.Option(help="folder of the entry")],
) -> None:
    """Make an entry of runs with at least 5 seeds: policies, results, a description."""
    from swarmdata.evaluation.leaderboard.entry import submit
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "an entry")
    submit(
        runs, out, dataset, name=name, license=license, code=code, trials=trials,
        tuning_episodes=tuning_episodes,
    )  # fmt: skip
    typer.echo(out)


@leaderboard_app.command("verify")
def verify_command(
    entry: Annotated[Path, typer.Argument(metavar="ENTRY", help="folder of the entry")],
    seconds: Annotated[float, typer.Option(min=1, help="most time")] = 600,
    threads: Threads = 1,
) -> None:
    """Evaluate an entry again, on reserved and on fresh episodes; exit code 1 if it is rejected."""
    from swarmdata.evaluation.leaderboard.verify import verify
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "verifying an entry")
    verdict = verify(entry, seconds=seconds, n_threads=threads)
    for reason in verdict.reasons:
        typer.echo(f"rejected: {reason}")
    if not verdict.is_verified:
        raise typer.Exit(1)
    typer.echo(
        f"verified: return {verdict.reserved:.3f} on the reserved episodes, {verdict.equal:.2%} of "
        f"which ended as it says in all metrics, and {verdict.fresh:.3f} on fresh ones"
    )
