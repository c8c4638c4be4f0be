"""Folders that commands write to: nothing in them is replaced but what such a command wrote.

Such a command leaves a list of its files, in JSON: the next one of its kind may replace and remove
them. All other files are the user's.
"""

import json
import os
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

from swarmdata.errors import OutputError
from swarmdata.runtime.atomic import (
    LEFTOVER,
    is_vacant,
    own_files,
    remove_leftovers,
    staged,
    sync,
    write_file,
)
from swarmdata.runtime.locking import beside, locked

FORMAT_VERSION = 2  # of the lists; version 1, of catalogues, named no files


@dataclass(frozen=True)
class OutputKind:
    """What a command writes to a folder."""

    name: str  # in words, such as `report`
    list_file: str = ".swarmdata-files.json"  # name of the list

    @property
    def format(self) -> str:
        return f"swarmdata-{self.name.replace(' ', '-')}"


def check_vacant(folder: Path, what: str, lack: str, besides: str = "") -> None:
    """Checks that a folder has no files of the user's, except names that match `besides`.

    The message says `what` it would be, and that it has no `lack`, which ours have.

    Raises:
        OutputError: it is no folder, or has content.
    """
    if os.path.lexists(folder) and not folder.is_dir():
        raise OutputError(f"{folder} is not a folder. Name a new one, or a {what}.")
    if is_vacant(folder):
        return
    allowed = re.compile(besides)
    names = sorted({each.name for each in folder.iterdir()} - own_files(folder))
    for name in names:
        if not (LEFTOVER.fullmatch(name) or allowed.fullmatch(name)):
            raise OutputError(
                f"{folder} has files in it, such as {name}, and is no {what} of swarmdata (it has "
                f"no {lack}), so nothing was written there. Name a new folder, or empty this one."
            )


def check_marked(folder: Path, marker: str, what: str, besides: str = "") -> None:
    """Checks that a folder has a file `marker` that makes it ours, or no files of the user's.

    Raises:
        OutputError: as `check_vacant` says.
    """
    if not (folder / marker).exists():
        lock = rf"\.{re.escape(marker)}\.lock"
        check_vacant(folder, what, marker, f"{lock}|{besides}" if besides else lock)


def check_output(folder: Path, kind: OutputKind, besides: str = "") -> None:
    """Checks that a folder may be written to by commands of a kind; takes what `check_marked` does.

    Raises:
        OutputError: it is no folder, or has content and no list of such files.
    """
    check_marked(folder, kind.list_file, kind.name, besides)
    if (folder / kind.list_file).exists():
        listed_files(folder, kind)


def listed_files(folder: Path, kind: OutputKind) -> frozenset[str]:
    """The files that commands of a kind wrote to a folder, relative to it; none without a list.

    Raises:
        OutputError: the list is of another kind or version, or malformed.
    """
    file = folder / kind.list_file
    try:
        content = json.loads(file.read_bytes())
        names = content["files"]
        if content["format"] != kind.format or not all(map(_is_inside, names)):
            raise ValueError(content["format"])
    except FileNotFoundError:
        return frozenset()
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise OutputError(
            f"{folder} is no {kind.name} of this version of swarmdata: {file.name} does not list "
            "the files of one, so nothing was written there. Name a new folder, or empty this one."
        ) from error
    return frozenset(names)


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts


@contextmanager
def filled(
    folder: Path, kind: OutputKind, *, whole: bool = False, besides: str = ""
) -> Iterator[Path]:
    """Yields a temporary folder whose files take their places in `folder` if the block ends well.

    What is `whole` appears in one rename, but for a moment between two of them where it takes the
    place of an earlier one. In a folder with files of the user's, at a mount point, and where it is
    not `whole`, files are replaced one by one; if that is interrupted, the next call goes on.

    Args:
        folder: to write to.
        kind: of what is written.
        whole: whether listed files go that are not written again.
        besides: as `check_marked` takes it.

    Raises:
        OutputError: the folder may not be written to, or has a file of the user's in the place of a
            new one. Nothing in it was changed.
        DiskFullError: no space was left.
    """
    folder = folder.resolve()
    check_output(folder, kind, besides)
    is_merged = folder.is_dir() and not whole  # then nothing has to be made beside it
    place = folder / kind.list_file if is_merged else folder
    if is_merged and os.access(folder.parent, os.R_OK | os.W_OK | os.X_OK):
        remove_leftovers(beside(folder), folder.name)  # of a call before which it was not there
    install = partial(_install, folder=folder, kind=kind, whole=whole, besides=besides)
    with staged(place, lambda source, _: install(source)) as target:
        target.mkdir()
        yield target


def _install(source: Path, *, folder: Path, kind: OutputKind, whole: bool, besides: str) -> None:
    check_output(folder, kind, besides)  # something may have come there meanwhile
    new = frozenset(_files(source))
    if whole and beside(folder) != folder and (not folder.is_dir() or _is_ours(folder, kind)):
        _write_list(source, kind, new)
        if folder.is_dir():
            folder.rename(source.parent / "earlier")  # deleted with the temporary folder
        source.rename(folder)
    else:
        with locked(folder / kind.list_file, shown=False):
            _merge(source, folder, kind, new, whole)


def _merge(source: Path, folder: Path, kind: OutputKind, new: frozenset[str], whole: bool) -> None:
    """Replaces files one by one; the list names whatever may be there, at every moment."""
    old = listed_files(folder, kind)
    for name in sorted(new):
        _check_place(folder, name, is_listed=name in old)
    _write_list(folder, kind, old | new)
    for name in sorted(new):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).replace(folder / name)
    for name in sorted(old - new) if whole else ():
        _remove(folder, name)
    sync(folder)
    if whole:
        _write_list(folder, kind, new)


def _check_place(folder: Path, name: str, *, is_listed: bool) -> None:
    """Raises OutputError where something of the user's is in the place of a new file."""
    path = folder / name
    theirs = [each for each in _parents(folder, name) if each.is_symlink() or not each.is_dir()]
    theirs += [path] if path.is_dir() or not is_listed else []
    for each in filter(os.path.lexists, theirs):
        raise OutputError(
            f"{each} is in the way: swarmdata did not write it, and a file of this name belongs "
            "there. Nothing was changed; move it away, or name another folder."
        )


def _parents(folder: Path, name: str) -> list[Path]:
    """The folders in `folder` that lead to a file, the innermost first."""
    return [folder / each for each in PurePosixPath(name).parents][:-1]


def _remove(folder: Path, name: str) -> None:
    """Removes a listed file, and its folders if they are empty then."""
    parents = _parents(folder, name)
    if any(each.is_symlink() for each in parents):
        return  # what the link leads to is the user's
    if not (folder / name).is_dir():
        (folder / name).unlink(missing_ok=True)
    for each in parents:
        if each.is_dir() and not any(each.iterdir()):
            each.rmdir()


def _is_ours(folder: Path, kind: OutputKind) -> bool:
    """Whether a folder has nothing in it but listed files."""
    return set(_files(folder)) <= listed_files(folder, kind) | {kind.list_file}


def _files(folder: Path) -> Iterator[str]:
    """Every file, link and empty folder below a folder, relative to it."""
    for each in folder.rglob("*"):
        if each.is_symlink() or not each.is_dir() or not any(each.iterdir()):
            yield each.relative_to(folder).as_posix()


def remove_others(folder: Path, kind: OutputKind, kept: Collection[str]) -> None:
    """Removes listed files that are none of those kept, as earlier commands of the kind left."""
    for name in listed_files(folder, kind).difference(kept):
        _remove(folder, name)


def _write_list(folder: Path, kind: OutputKind, files: frozenset[str]) -> None:
    content = {"format": kind.format, "format_version": FORMAT_VERSION, "files": sorted(files)}
    write_file(folder / kind.list_file, f"{json.dumps(content, indent=0)}\n".encode())
