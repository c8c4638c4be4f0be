"""Shares of a dataset's parts, for schedulers: share k of N may run anywhere, any time, twice."""

import math
import shutil
from itertools import count
from pathlib import Path

from swarmdata.building.build import build
from swarmdata.building.part_exchange import PartExchange
from swarmdata.building.part_maker import make_copies, make_part
from swarmdata.building.parts_folder import Parts, build_folder
from swarmdata.errors import BuildError, SpecError
from swarmdata.hub.remotes.interface import Remote
from swarmdata.specs.recipe import Recipe
from swarmdata.store.manifest import is_finished
from swarmdata.store.parts import write_part
from swarmdata.store.table import n_steps_of


def make_share(
    recipe: Recipe,
    out: Path,
    share: int,
    n_shares: int,
    *,
    checkpoints: Path | None = None,
    remote: Remote | None = None,
) -> list[str]:
    """Makes the parts `share`, `share` + N, ... of each policy that are not there yet.

    Args:
        recipe: what to make.
        out: the dataset's folder; where it is finished, nothing is done.
        share: k, from 1 to N.
        n_shares: N.
        checkpoints: as `build` takes them.
        remote: where parts are sent, each when it is made; those of this share that are there are
            fetched first. None: all shares see the folder of `out`.

    Returns:
        Names of the parts that were made.

    Raises:
        SpecError: k is not from 1 to N.
        RecipeConflictError: `out` or its parts belong to another recipe.
        CheckpointError: a network that the recipe names is absent, or is another one.
        HubError: the remote could not be asked, or takes whole datasets only.
    """
    if not 1 <= share <= n_shares:
        raise SpecError(f"share {share}/{n_shares} does not exist, expected 1/N to N/N")
    parts = _opened(recipe, out, checkpoints)
    if parts is None:
        return []
    exchange = None if remote is None else PartExchange(parts, remote)
    if exchange is not None:
        exchange.receive(share, n_shares)
        exchange.send()  # what a killed process had made
    env, made = make_copies(recipe), []
    for policy in range(len(recipe.policies)):
        for part in count(share - 1, n_shares):
            if parts.tables_of(policy) and part >= _n_needed(parts, policy):
                break
            path = parts.path(policy, part)
            if path.exists():
                continue
            write_part(path, make_part(recipe, policy, part, env, folder=parts.folder))
            made.append(parts.job(policy, part).name)
            if exchange is not None:
                exchange.send()
            if is_finished(out, recipe):  # by another process, which needed no more parts
                _withdraw(path)
                return made
    return made


def receive_parts(
    recipe: Recipe, out: Path, remote: Remote, *, checkpoints: Path | None = None
) -> int:
    """Fetches the parts that shares have sent to a remote; returns how many.

    Raises:
        ChecksumError: a part is damaged there.
        HubError: the remote could not be asked, or takes whole datasets only.
        RecipeConflictError: `out` or its parts belong to another recipe.
    """
    parts = _opened(recipe, out, checkpoints)
    return 0 if parts is None else PartExchange(parts, remote).receive()


def _opened(recipe: Recipe, out: Path, checkpoints: Path | None) -> Parts | None:
    """The folder of parts, begun if it is not there; None: the dataset is finished."""
    if is_finished(out, recipe):
        return None
    out.parent.mkdir(parents=True, exist_ok=True)
    parts = Parts(recipe, build_folder(out))
    parts.open(checkpoints)
    return parts


def finish_parts(recipe: Recipe, out: Path, *, progress: bool = True) -> Path:
    """Assembles the parts of all shares, and simulates nothing.

    Raises:
        BuildError: parts are missing.
        RecipeConflictError: `out` or its parts belong to another recipe.
    """
    if is_finished(out, recipe):
        return out
    parts = Parts(recipe, build_folder(out))
    merge = parts.merge() if parts.is_ours() else None
    if merge is None or merge.lacking is not None:
        have = n_steps_of(*parts.all_tables()) if merge else 0
        raise BuildError(
            f"{recipe.id} has parts of {have:,} joint steps in {parts.folder}, which are not "
            f"enough for {recipe.n_steps:,}. Run all shares to their end; or leave out --finish, "
            "and the missing parts are made here."
        )
    return build(recipe, out, workers=1, progress=progress)


def _n_needed(parts: Parts, policy: int) -> int:
    """Parts that a policy will need, by the mean of those that are there."""
    tables = parts.tables_of(policy)
    return math.ceil(parts.needed_steps(policy) / (n_steps_of(*tables) / len(tables)))


def _withdraw(path: Path) -> None:
    """Removes a part that came too late, and the folder that was made for it."""
    shutil.rmtree(path)
    if not any(path.parent.iterdir()):
        path.parent.rmdir()
