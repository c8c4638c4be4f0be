"""Files of checkpoints: found by name, and checked by digest."""

import hashlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from swarmdata.errors import CheckpointError
from swarmdata.runtime.regular_files import read_regular
from swarmdata.specs.plain_names import checked_file_name
from swarmdata.specs.recipe import PolicySource, who_acts
from swarmdata.store.arrays.layout import CHECKPOINTS

MAX_CHECKPOINT_BYTES = 1 << 24  # of a file that is read; the shipped ones have about 2**16


def digest_of(path: Path) -> str:
    """Returns the SHA-256 of a checkpoint file, hex.

    Raises:
        CheckpointError: it cannot be read, is not a regular file, or is too large.
    """
    return hashlib.sha256(_content(path)).hexdigest()


def read_checkpoint(checkpoint: str | Path, sha256: str, folder: Path | None = None) -> bytes:
    """Returns the bytes of a checkpoint file.

    Args:
        checkpoint: a file's name, as in recipes, which is looked up in the package's checkpoints
            and then in those of `folder`; or the path of any other checkpoint. Recipes contain
            names only, never paths.
        sha256: the expected digest, hex.
        folder: of the dataset whose recipe names the checkpoint, if there is one.

    Raises:
        CheckpointError: the file is absent, is not a regular file, is too large, or has another
            digest.
    """
    path = checkpoint if isinstance(checkpoint, Path) else _find(checkpoint, folder)
    data = _content(path, follow_links=folder is None or path.parent != folder / CHECKPOINTS)
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256.lower():
        raise CheckpointError(
            f"checkpoint {path} has SHA-256 {digest}, expected {sha256}. "
            "Restore the file that the recipe names, or update the recipe."
        )
    return data


def own_checkpoints(policies: Iterable[PolicySource], folder: Path | None) -> dict[str, bytes]:
    """Returns the checkpoints that recipes name and the package does not have, by file name.

    Args:
        policies: of a recipe.
        folder: with a folder `checkpoints`; None: there is none.

    Raises:
        CheckpointError: one is absent, or is not the one that its recipe means.
    """
    found = {}
    for source in who_acts(policies):
        name, sha256 = source.checkpoint, source.sha256
        if name is None or sha256 is None or _shipped(name).exists():
            continue
        if folder is None or not (folder / CHECKPOINTS / name).exists():
            raise CheckpointError(
                f"the recipe's policy {source.label!r} needs the checkpoint {name}, which is not "
                f"in the package{'' if folder is None else f' or in {folder / CHECKPOINTS}'}. "
                "It is in the folder of every dataset of the recipe: build from the recipe.json "
                "there, or copy its folder checkpoints beside the recipe."
            )
        found[name] = read_checkpoint(name, sha256, folder)
    return found


def _find(name: str, folder: Path | None) -> Path:
    """Returns the path of a named checkpoint, in the package or in a dataset's folder."""
    try:
        checked_file_name(name)
    except ValueError as error:
        raise CheckpointError(
            f"checkpoint {error}. Checkpoints are in the folder {CHECKPOINTS!r} of the "
            "package, or of the dataset."
        ) from error
    shipped = _shipped(name)
    if shipped.exists() or folder is None:
        return shipped
    if (folder / CHECKPOINTS).is_symlink():
        raise CheckpointError(f"{folder / CHECKPOINTS} is a symbolic link, expected a folder")
    return folder / CHECKPOINTS / name


def _shipped(name: str) -> Path:
    """The path that a checkpoint of the package has."""
    return Path(str(files("swarmdata.behavior_policies"))) / CHECKPOINTS / name


def _content(path: Path, *, follow_links: bool = True) -> bytes:
    try:
        return read_regular(path, MAX_CHECKPOINT_BYTES, follow_links=follow_links)
    except OSError as error:
        raise CheckpointError(f"cannot read checkpoint {path}: {error}") from error
