"""Names that come from outside: ids of datasets, and files that a remote lists."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from swarmdata.errors import AddressError, did_you_mean

MAX_ID_LENGTH = 96  # longest id, version included

MAX_PATH_BYTES = 240
"""Most bytes of a file's path in a dataset: with a folder before it, systems allow 255."""

ID_PATTERN = re.compile(r"([a-z0-9_]+(?:-[a-z0-9_]+)+)-(v[0-9]+)")
_PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]*(?:/[A-Za-z0-9_][A-Za-z0-9._-]*)*")
_OUT = re.compile(r"^$|^/|/$|//|(?:^|/)\.{1,2}(?:/|$)|\\|^[A-Za-z]:|[\x00-\x1f\x7f]")
_DEVICES = re.compile(r"(?i)(?:^|/)(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\.[^/]*)?(?:/|$)")


def split_id(dataset_id: str, known: Iterable[str] = ()) -> tuple[str, str]:
    """Splits `coop_nav-medium-v1` into `coop_nav-medium` and `v1`.

    Raises:
        AddressError: it is not an id with a version.
    """
    if not is_id(dataset_id):
        is_long = len(dataset_id) > MAX_ID_LENGTH
        shown = f"{dataset_id[:MAX_ID_LENGTH]}..." if is_long else dataset_id
        raise AddressError(
            f"{shown!r} is not the id of a dataset, expected at most {MAX_ID_LENGTH} characters "
            f"such as 'coop_nav-medium-v1': words of a-z, 0-9 and _, joined by -, then the version."
            f"{did_you_mean(shown, known)}"
        )
    name, _, version = dataset_id.rpartition("-")
    return name, version


def is_id(text: str) -> bool:
    """Whether this is the id of a dataset, version included."""
    return len(text) <= MAX_ID_LENGTH and ID_PATTERN.fullmatch(text) is not None


def is_address(text: str) -> bool:
    """Whether this is meant as an address, rather than as an id or a path."""
    return "://" in text


def is_folder(text: str | Path) -> bool:
    """Whether this names a folder that is there; what no system takes for a name does not."""
    try:
        return Path(text).is_dir()
    except (OSError, ValueError):  # such as a name that is too long, or not to be looked into
        return False


def looks_like_path(text: str) -> bool:
    """Whether this is written like the path of a file or folder; no id is."""
    return "/" in text or "\\" in text or text.startswith((".", "~"))


def unsafe_names(names: Iterable[str]) -> tuple[str, ...]:
    """What speaks against writing files of these names into one folder, on any system.

    Names are relative POSIX paths of plain characters, without hidden, empty or parent components
    and device names, and no two of them are equal but for case.
    """
    every = list(names)
    problems = []
    for name in every:
        if len(name.encode(errors="replace")) > MAX_PATH_BYTES:
            problems.append(f"{name[:40]!r}... is longer than {MAX_PATH_BYTES} bytes")
        elif not _PATH.fullmatch(name) or _DEVICES.search(name):
            problems.append(f"{name!r} is not a plain relative path")
    return (*problems, *_colliding(every))


def hostile_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names in a remote's listing that lead out of a folder, or are one file on some systems.

    A repository may have other files than a dataset's, of any harmless name.
    """
    every = list(names)
    problems = [f"{name[:100]!r} leads out of a folder" for name in every if _OUT.search(name)]
    return (*problems, *_colliding(every))


def _colliding(names: Sequence[str]) -> tuple[str, ...]:
    counts = Counter(name.casefold() for name in names)
    twice = sorted(name for name in names if counts[name.casefold()] > 1)
    shown = ", ".join(map(repr, twice))
    return (f"{shown} are the same file on some systems",) if twice else ()
