"""The files beside a dataset's own ones, which are in no digest: the card and the references."""

import itertools
from pathlib import Path

from swarmdata.cards.card import side_files, write_card
from swarmdata.cards.references import reference_bytes
from swarmdata.errors import SchemaError, SpecError
from swarmdata.store import open_store, write_file
from swarmdata.store.arrays.layout import CARD, REFERENCES
from swarmdata.store.damage import Damage


def finish(folder: Path) -> None:
    """Writes the missing side files; this is the last step of everything that makes a dataset.

    The card is written last, so a dataset with a card is finished. Existing files are kept.

    Raises:
        DatasetError: the dataset cannot be used.
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
    """
    origin = open_store(folder, verify="none").recipe
    content = reference_bytes(origin.spec)
    if not (folder / CARD).exists() and origin.missing is None:
        write_card(folder)
    elif content is not None and not (folder / REFERENCES).exists():
        write_file(folder / REFERENCES, content)


def damage_of(folder: Path) -> tuple[Damage, ...]:
    """Compares the side files of a dataset, whose own files are sound, with what we would write.

    Raises:
        DatasetError: the dataset cannot be used.
    """
    origin = open_store(folder, verify="none").recipe
    if origin.missing is not None:  # the package that defines it makes the card
        return ()
    try:
        expected = side_files(folder)
    except (SchemaError, SpecError) as error:
        if not (folder / CARD).is_file():
            return (Damage(CARD, "is absent"),)
        return (Damage(CARD, f"cannot be compared, because no card can be made: {error}"),)
    problems = {name: _problem(folder / name, content) for name, content in expected.items()}
    return tuple(Damage(name, problem) for name, problem in problems.items() if problem)


def _problem(path: Path, expected: bytes) -> str:
    """Describes how one file differs; empty if it does not."""
    if path.is_symlink():
        return "is a symbolic link, expected a plain file"
    try:
        found = path.read_bytes()
    except FileNotFoundError:
        return "is absent"
    except OSError as error:  # such as a folder of this name
        return f"cannot be read: {error.strerror or error}"
    if found == expected:
        return ""
    pairs = [*itertools.zip_longest(found.splitlines(), expected.splitlines())]
    line = next((k for k, (one, other) in enumerate(pairs, 1) if one != other), len(pairs) + 1)
    return (
        f"is not what the other files give: line {line} is the first that differs. It was changed, "
        "or written by another version of swarmdata"
    )
