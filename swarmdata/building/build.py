"""Builds the dataset that a recipe describes: in parallel parts, resumable, the same bits always.

Part k of a policy holds the episodes k * part_episodes and on of that policy's stream, and is a
pure function of the recipe and k. So it does not matter who makes a part, when, or how often.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from swarmdata.behavior_policies.learned import own_checkpoints
from swarmdata.cards.side_files import finish
from swarmdata.errors import BuildError, RecipeConflictError
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env
from swarmdata.registry.replaced_worlds import check_world
from swarmdata.rollouts.recipe_episodes import SIMULATED_COPIES, episode_seeds, make_source_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.locking import locked
from swarmdata.runtime.workers import Crew, Job, Report, serve
from swarmdata.specs.frozen import differences
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import (
    Manifest,
    MergeOrder,
    PartTable,
    assemble,
    merge_order,
    read_manifest,
    read_part_table,
    remove_leftovers,
    write_file,
    write_part,
)
from swarmdata.store.arrays.layout import CARD, CHECKPOINTS, MANIFEST, RECIPE, REFERENCES
from swarmdata.store.cache import note_build
from swarmdata.store.manifest import check_recipe
from swarmdata.types import Episode

_PART = re.compile(r"policy-\d+-part-\d{5,}")
"""Names of parts."""


def build(
    recipe: Recipe,
    out: Path,
    *,
    checkpoints: Path | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> Path:
    """Makes the dataset, or what is missing of it, and returns `out`.

    Parts are collected in `<out>.build` and removed at the end. Kill the process at any time and
    call again: finished parts are kept, and the dataset is the same. Where another process builds
    the same dataset, this one waits for it.

    Args:
        recipe: what to make.
        out: the dataset's folder; where it is finished already, nothing is done.
        checkpoints: a folder with a folder `checkpoints`, which has the networks that the recipe
            names and the package does not have, such as that of a dataset of the recipe. They are
            copied into the new dataset. None: there are none, or a build that was interrupted has
            them already.
        workers: processes that simulate; by default one for each core.
        progress: whether to show a bar in joint steps, on standard error.

    Raises:
        RecipeConflictError: `out` or `<out>.build` belongs to another recipe.
        BuildError: a part could not be made, or the disk is too small.
        CheckpointError: a network that the recipe names is absent, or is another one.
        SpecError: the recipe is of an older version of the world.
    """
    out = Path(out)
    if is_finished(out, recipe):
        return out
    with locked(out, progress):
        build_under_lock(recipe, out, checkpoints=checkpoints, workers=workers, progress=progress)
    return out


def build_under_lock(
    recipe: Recipe,
    out: Path,
    *,
    checkpoints: Path | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> None:
    """Does what `build` does, for a caller that holds the lock of `out`."""
    if is_finished(out, recipe):
        return  # another process built it while this one waited for the lock
    remove_leftovers(out.parent, out.name)
    remove_leftovers(out, MANIFEST, REFERENCES, CARD)
    if not out.exists():
        check_world(recipe.spec)  # before the folder of parts is made
        parts = _Parts(recipe, build_folder(out))
        parts.open(checkpoints)
        note_build(_make(parts, out, workers or os.cpu_count() or 1, progress))
    remove_parts(recipe, out)
    finish(out)  # a dataset with a card has passed the card's checks


def build_folder(out: Path) -> Path:
    """Where the parts of an unfinished dataset are."""
    whole = out.resolve()  # `.` has no name
    return whole.parent / f"{whole.name}.build"


def remove_parts(recipe: Recipe, out: Path) -> None:
    """Removes the parts of a recipe in `build_folder(out)`, the note of the recipe last.

    The folder is removed as well, unless it holds other files. A folder without the note of this
    recipe is not touched: it belongs to another recipe or to the user.
    """
    parts = _Parts(recipe, build_folder(out))
    if not parts.folder.is_dir():
        return
    parts.remove_leftovers()
    if parts.is_ours():
        for path in parts.all():
            shutil.rmtree(path)
        parts.remove_checkpoints()
        parts.note.unlink()
    if not any(parts.folder.iterdir()):
        parts.folder.rmdir()


def make_part(
    recipe: Recipe,
    policy: int,
    part: int,
    env: VecEnv,
    report: Report = lambda steps: None,
    folder: Path | None = None,
) -> list[Episode]:
    """Simulates part number `part` of one policy's stream.

    Args:
        recipe: the recipe.
        policy: index into `recipe.policies`.
        part: k.
        env: copies of the recipe's task; any number of them gives the same episodes.
        report: called with the joint steps of each episode.
        folder: with a folder `checkpoints` of the recipe's own networks, if it has any.
    """
    seeds = episode_seeds(recipe, policy, part * recipe.part_episodes, recipe.part_episodes)
    actor = make_source_policy(recipe.policies[policy], recipe.spec, folder)
    episodes = []
    for episode in rollout(env, actor, seeds, policy_index=policy):
        episodes.append(episode)
        report(len(episode))
    return episodes


def work() -> None:
    """Makes parts until told to stop; runs in worker processes."""
    copies: dict[tuple[TaskSpec, int], VecEnv] = {}  # kept from part to part

    def handle(payload: dict[str, Any], report: Report) -> None:
        recipe = Recipe.from_text(payload["recipe"])
        n_copies = min(SIMULATED_COPIES, recipe.part_episodes)  # more would have no episode to run
        kind = recipe.spec, n_copies
        if kind not in copies:
            copies[kind] = make_env(*kind)
        env = copies[kind]
        out = Path(payload["folder"])
        episodes = make_part(recipe, payload["policy"], payload["part"], env, report, out.parent)
        write_part(out, episodes)

    serve(handle)


def is_finished(out: Path, recipe: Recipe) -> bool:
    """Whether `build` has nothing left to do; what is finished is never written to.

    Raises:
        RecipeConflictError: `out` holds a dataset of another recipe.
        DatasetError: `out` is there and has no readable manifest.
    """
    if not out.exists():
        return False
    check_recipe(out, read_manifest(out), recipe)
    return (out / CARD).exists()


def _make(parts: "_Parts", out: Path, workers: int, progress: bool) -> Manifest:
    recipe = parts.recipe
    with _bar(recipe, parts, progress) as report, Crew(f"{__name__}:work", workers) as crew:
        while (merge := parts.merge()).lacking is not None:
            parts.check_space()
            crew.run(parts.wave(merge, workers), report)
    networks = own_checkpoints(recipe.policies, parts.folder)
    return assemble(
        out, recipe=recipe, parts=parts.folders(), order=merge.order, checkpoints=networks
    )


@contextmanager
def _bar(recipe: Recipe, parts: "_Parts", shown: bool) -> Iterator[Report]:
    """A progress bar over joint steps; it starts at what earlier runs have made."""
    have = min(recipe.n_steps, sum(table.n_steps for table in parts.all_tables()))
    with tqdm(
        total=recipe.n_steps,
        initial=have,
        unit="step",
        unit_scale=True,
        desc=recipe.id,
        disable=None if shown else True,  # None: hidden where there is no terminal
    ) as bar:

        def report(steps: int) -> None:
            bar.total = max(recipe.n_steps, bar.n + steps)  # the last parts overshoot
            bar.update(steps)

        yield report


@dataclass(frozen=True)
class _Parts:
    """The folder of parts of one recipe."""

    recipe: Recipe
    folder: Path

    def open(self, checkpoints: Path | None) -> None:
        """Creates the folder, or checks that the one there is of the same recipe.

        Args:
            checkpoints: folder with a folder `checkpoints` of the recipe's own networks, which are
                copied; None: they are here already, or there are none.
        """
        source = self.folder if checkpoints is None else checkpoints
        networks = own_checkpoints(self.recipe.policies, source)  # before the folder is made
        self.folder.mkdir(exist_ok=True)
        self._note()
        for name, content in networks.items():
            (self.folder / CHECKPOINTS).mkdir(exist_ok=True)
            write_file(self.folder / CHECKPOINTS / name, content)

    def _note(self) -> None:
        """Writes the note of the recipe, or compares the one that is there."""
        self.remove_leftovers()
        if not self.note.exists():
            if any(self.folder.iterdir()):
                raise BuildError(
                    f"{self.folder} is not a folder of parts: it has other files and no {RECIPE}. "
                    "Parts of a build are collected there. Move it away, or choose another folder "
                    "for the dataset."
                )
            write_file(self.note, self.recipe.to_json().encode())
            return
        there = Recipe.from_file(self.note)
        if there != self.recipe:
            changes = "; ".join(
                f"{path} is {old!r} there, {new!r} in the recipe"
                for path, old, new in differences(there, self.recipe)
            )
            raise RecipeConflictError(
                f"{self.folder} holds parts of another recipe: {changes}. "
                "Delete it or choose another folder."
            )

    @property
    def note(self) -> Path:
        """The recipe that the parts are of, by which the folder is known."""
        return self.folder / RECIPE

    def is_ours(self) -> bool:
        """Whether the folder has been begun with this recipe."""
        try:
            return Recipe.from_file(self.note) == self.recipe
        except (OSError, ValueError):  # absent, or a file of the user's
            return False

    def remove_leftovers(self) -> None:
        remove_leftovers(self.folder, RECIPE, _PART)

    def remove_checkpoints(self) -> None:
        """Removes the copies of the recipe's networks, and their folder if it is empty then."""
        folder = self.folder / CHECKPOINTS
        if not folder.is_dir():
            return
        remove_leftovers(folder)
        for source in self.recipe.policies:
            if source.checkpoint is not None:
                (folder / source.checkpoint).unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()

    def all(self) -> list[Path]:
        """Every part, those after a gap included."""
        return sorted(path for path in self.folder.iterdir() if _PART.fullmatch(path.name))

    def path(self, policy: int, part: int) -> Path:
        return self.folder / f"policy-{policy}-part-{part:05d}"

    def folders(self) -> dict[int, list[Path]]:
        """Consecutive finished parts of each policy, from part 0."""
        found: dict[int, list[Path]] = {}
        for policy in range(len(self.recipe.policies)):
            found[policy] = []
            while (path := self.path(policy, len(found[policy]))).exists():
                found[policy].append(path)
        return {policy: paths for policy, paths in found.items() if paths}

    def tables(self) -> list[list[PartTable]]:
        """Tables of the parts in `folders`, by policy."""
        folders = self.folders()
        return [
            [read_part_table(path) for path in folders.get(policy, [])]
            for policy in range(len(self.recipe.policies))
        ]

    def all_tables(self) -> list[PartTable]:
        return [table for tables in self.tables() for table in tables]

    def merge(self) -> MergeOrder:
        lengths = [[int(n) for table in tables for n in table.lengths] for tables in self.tables()]
        return merge_order(self.recipe, lengths)

    def wave(self, merge: MergeOrder, workers: int) -> list[Job]:
        """The parts to make next: what each policy's share still needs, by its mean part so far.

        A policy without parts gets one; after that the estimates are good, and hardly any part is
        made that the dataset does not need.
        """
        whole = sum(source.share for source in self.recipe.policies)
        jobs = []
        for policy, tables in enumerate(self.tables()):
            steps = sum(table.n_steps for table in tables)
            left = self.recipe.n_steps * self.recipe.policies[policy].share / whole - steps
            mean = steps / len(tables) if tables else self.recipe.n_steps
            n_parts = max(int(policy == merge.lacking or not tables), round(left / mean))
            jobs += [self._job(policy, len(tables) + k) for k in range(n_parts)]
        return jobs

    def _job(self, policy: int, part: int) -> Job:
        return Job(
            name=f"part {part} of {self.recipe.policies[policy].label}",
            payload={
                "recipe": self.recipe.to_json(),
                "policy": policy,
                "part": part,
                "folder": str(self.path(policy, part)),
            },
        )

    def check_space(self) -> None:
        """Raises if the disk cannot hold the missing parts and the assembled dataset.

        Sizes are those of the parts that are there; before the first part nothing is known.
        """
        have = sum(table.n_steps for table in self.all_tables())
        if not have:
            return
        size = sum(file.stat().st_size for file in self.folder.glob("policy-*/*"))
        per_step = size / have
        needed = per_step * (max(0, self.recipe.n_steps - have) + self.recipe.n_steps)
        free = shutil.disk_usage(self.folder).free
        if free < needed:
            raise BuildError(
                f"{self.recipe.id} needs {needed / 1e6:.0f} MB more in {self.folder.parent}, which "
                f"has {free / 1e6:.0f} MB free. Make room or choose another folder; finished parts "
                "are kept."
            )
