"""Builds the dataset of a recipe: in parallel parts, resumable, the same bits always."""

import os
import shutil
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from swarmdata.behavior_policies.checkpoint_files import own_checkpoints
from swarmdata.building.parts_folder import Parts, build_folder
from swarmdata.runtime.atomic import is_vacant
from swarmdata.runtime.engines.crew import Crew
from swarmdata.runtime.engines.jobs import Job, Report, usable_cores
from swarmdata.runtime.engines.open_engine import LOCAL, Engine, open_engine
from swarmdata.runtime.locking import locked
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest, read_manifest, remove_leftovers
from swarmdata.store.arrays.layout import CARD, MANIFEST, REFERENCES
from swarmdata.store.assembly import assemble, own_code
from swarmdata.store.manifest import is_finished, note_build
from swarmdata.store.table import n_steps_of

PART_MAKER = "swarmdata.building.part_maker:part_maker"


def build(
    recipe: Recipe,
    out: Path | str,
    *,
    checkpoints: Path | str | None = None,
    workers: int | None = None,
    engine: str | Executor = LOCAL,
    progress: bool = True,
) -> Path:
    """Makes the dataset, or what is missing of it, and returns `out`.

    Parts are collected in `<out>.build` and removed at the end. Kill the process at any time and
    call again: finished parts are kept, and the dataset is the same. Where another process builds
    the same dataset, this one waits for it. Without room for parts and dataset together, parts are
    deleted while they are joined, and made again if that is interrupted.

    Args:
        recipe: what to make.
        out: the dataset's folder; where it is finished already, nothing is done.
        checkpoints: a folder with a folder `checkpoints`, which has the networks that the recipe
            names and the package does not have; they are copied. None: there are none, or a build
            that was interrupted has them already.
        workers: processes of the engine `local` that simulate; by default one for each core.
        engine: where parts are made: `local`, `dask://HOST:PORT`, `slurm[:PARTITION]`, `ray`, or an
            executor. All see the folder of `out`.
        progress: whether to show a bar in joint steps, on standard error.

    Raises:
        RecipeConflictError: `out` or `<out>.build` belongs to another recipe.
        EngineError: the engine is unknown, or cannot be reached.
        BuildError: a part could not be made, or the disk is too small.
        CheckpointError: a network that the recipe names is absent, or is another one.
    """
    out = Path(out)
    checkpoints = None if checkpoints is None else Path(checkpoints)
    if _is_done(out, recipe):
        _compare_code(out, recipe)
        return out
    with locked(out, progress):
        build_under_lock(
            recipe, out, checkpoints=checkpoints, workers=workers, engine=engine, progress=progress
        )
    return out


def build_under_lock(
    recipe: Recipe,
    out: Path,
    *,
    checkpoints: Path | None = None,
    workers: int | None = None,
    engine: str | Executor = LOCAL,
    progress: bool = True,
) -> None:
    """Does what `build` does, for a caller that holds the lock of `out`."""
    if _is_done(out, recipe):
        return  # another process built it while this one waited for the lock
    remove_leftovers(out.parent, out.name)
    remove_leftovers(out, MANIFEST, REFERENCES, CARD)
    n_workers = workers or usable_cores()
    with open_engine(engine, PART_MAKER, n_workers=n_workers, folder=out) as makers:
        if is_vacant(out):
            parts = Parts(recipe, build_folder(out))
            parts.open(checkpoints)
            note_build(_make(parts, out, makers, progress))
        remove_parts(recipe, out)
        _finish(recipe, out, makers)  # a dataset with a card has passed the card's checks


def _is_done(out: Path, recipe: Recipe) -> bool:
    """Whether the dataset is finished; then nothing stays in it of a kill after its last file."""
    if not is_finished(out, recipe):
        return False
    if os.access(out, os.R_OK | os.W_OK | os.X_OK):
        remove_leftovers(out, MANIFEST, REFERENCES, CARD)
    return True


def _compare_code(out: Path, recipe: Recipe) -> None:
    """Warns if a finished dataset was made by other code of users than there is now."""
    made_by = read_manifest(out).provenance
    for name, code in own_code(recipe.spec, recipe.policies).items():
        if made_by.get(name, code) != code:
            text = f"{out} was made before the {name} changed; build it anew in another folder"
            warnings.warn(text, stacklevel=3)


def remove_parts(recipe: Recipe, out: Path) -> None:
    """Removes the parts of a recipe in `build_folder(out)`, the note of the recipe last.

    The folder is removed as well, unless it holds other files. A folder without the note of this
    recipe is not touched: it belongs to another recipe or to the user.
    """
    parts = Parts(recipe, build_folder(out))
    if not parts.folder.is_dir():
        return
    parts.remove_leftovers()
    if parts.is_ours():
        for path in parts.all():
            shutil.rmtree(path)
        parts.remove_checkpoints()
        parts.code.unlink(missing_ok=True)
        parts.note.unlink()
    if not any(parts.folder.iterdir()):
        parts.folder.rmdir()


def _make(parts: Parts, out: Path, makers: Engine, progress: bool) -> Manifest:
    recipe = parts.recipe
    with _bar(recipe, parts, progress) as report:
        while (merge := parts.merge()).lacking is not None:
            parts.check_space()
            makers.run(parts.wave(merge), report)
    networks = own_checkpoints(recipe.policies, parts.folder)
    return assemble(
        out,
        recipe=recipe,
        parts=parts.folders(),
        order=merge.order,
        checkpoints=networks,
        consume=not parts.has_room_for_copy(),
    )


def _finish(recipe: Recipe, out: Path, makers: Engine) -> None:
    if isinstance(makers, Crew):  # its workers have loaded compiled code, which takes seconds
        makers.run([Job(f"the card of {recipe.id}", {"finish": str(out.resolve())})])
    else:
        from swarmdata.cards.side_files import finish  # noqa: PLC0415

        finish(out)


@contextmanager
def _bar(recipe: Recipe, parts: Parts, shown: bool) -> Iterator[Report]:
    """A progress bar over joint steps; it starts at what earlier runs have made."""
    have = min(recipe.n_steps, n_steps_of(*parts.all_tables()))
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
