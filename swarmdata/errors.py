"""The errors that swarmdata raises.

Catch `SwarmdataError` to handle them all. Each type is also the builtin exception in brackets, so
`except ValueError` works as well. A message says what was found, what was expected, where, and what
to do next.

SwarmdataError
├── UnknownNameError (KeyError)         no task, preset, policy or dataset has this name
├── SpecError (ValueError)              a spec or recipe is malformed or asks for the impossible
├── SchemaError (ValueError)            an array has the wrong shape, dtype or range
│   └── PolicyFitError                  a trained policy cannot act in a task or with models
├── SpawnError (RuntimeError)           no collision-free layout was found for a spec
├── CheckpointError (ValueError)        a checkpoint is malformed or not the one the recipe names
├── MissingExtraError (ImportError)     an optional dependency is not installed
├── ConversionError (ValueError)        data in another format is ambiguous, broken or does not fit
├── ProgramError (OSError)              an external program, such as ffmpeg, is missing or failed
├── DivergedError (ArithmeticError)     training produced NaN or infinite values
├── SimulationError (ArithmeticError)   a simulator could not go on with a world
├── BuildError (RuntimeError)           a dataset could not be built
│   ├── BatchError                      items of a batch failed, the others are done
│   └── RecipeConflictError             the folder holds parts that another recipe built
├── StudyError (RuntimeError)           a study, or one of its cells, could not be finished
│   └── StaleCellError                  a cell's folder holds results of another configuration
├── FileKindError (OSError)             a file is not a regular file, or is too large
├── OutputError (FileExistsError)       a folder to write to has files that are not ours
├── DiskFullError (OSError)             the disk or the quota is full
├── AddressError (ValueError)           the address of a remote or the id of a dataset is malformed
├── GateError (ValueError)              a dataset does not meet the conditions for publication
├── ResultsError (ValueError)           results are out of date or cannot be combined
├── HubError (OSError)                  a remote could not be reached or refused a request
│   ├── AbsentFileError                 the remote has no such file
│   ├── ConflictError                   another push to the same place came first
│   └── VersionTakenError               this version is already published and cannot be replaced
└── DatasetError (OSError)              a stored dataset cannot be used
    ├── DatasetNotFoundError            there is no dataset at this path
    ├── MissingManifestError            the folder has no manifest: unfinished, or the file was lost
    ├── ManifestError                   the manifest is unreadable or inconsistent
    ├── FormatVersionError              a newer version of swarmdata wrote the dataset
    ├── MissingFileError                a file that the manifest lists is missing
    ├── TruncatedFileError              a file does not have the size that the manifest lists
    └── ChecksumError                   a file's bytes have changed since it was written
"""

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

MOST_QUOTED = 200
"""Characters of a text from outside that a message repeats."""

_USER_PART = re.compile(r"(?<=://)[^\s/?#]*@")
_QUERY = re.compile(r"(://[^\s?'\"<>]*)\?[^\s'\"<>]+")


def printable(text: str) -> str:
    """Text as a terminal may show it: nothing controls it, and no address gives a secret away.

    Control characters and those that change the direction of text become their escapes, but for
    ends of lines and tabs. Addresses lose their user and password, and their query, in which signed
    links have their signature.
    """
    shown = _QUERY.sub(r"\1?…", _USER_PART.sub("", text))
    if shown.isprintable():
        return shown
    return "".join(
        each if each.isprintable() or each in "\n\t" else each.encode("unicode_escape").decode()
        for each in shown
    )


def quoted(text: object) -> str:
    """What somebody else wrote, as a message repeats it: one line, shortened, and `printable`."""
    line = printable(" ".join(str(text).split()))
    return line if len(line) <= MOST_QUOTED else f"{line[:MOST_QUOTED]}…"


class SwarmdataError(Exception):
    """Base class of every error that this library raises."""

    def __str__(self) -> str:
        """Returns the `printable` message, without the quotes in which `KeyError` shows it."""
        return printable(str(self.args[0])) if self.args else ""


INSTALL_HINT = "If another package defines it, install that package."
"""What to do about an unknown name of something that users can define."""

MOST_NAMES = 12
"""Known names that a message lists."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Returns " Did you mean 'x'?" for the closest known name, or "" if none is close."""
    near = difflib.get_close_matches(name[:100], list(known), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def listed(name: str, known: Iterable[str]) -> str:
    """Returns the known names in words: all of a few, else those nearest to `name`, sorted."""
    options = sorted(known)
    if len(options) <= MOST_NAMES + 1:  # "and 1 more" would hide a name that fits
        return ", ".join(options)
    near = sorted(options, key=lambda each: -difflib.SequenceMatcher(None, name, each).ratio())
    return f"{', '.join(sorted(near[:MOST_NAMES]))} and {len(options) - MOST_NAMES} more"


class UnknownNameError(SwarmdataError, KeyError):
    """No task, preset, policy or dataset has this name; the message lists the nearest names."""

    def __init__(self, kind: str, name: str, known: Iterable[str], hint: str = "") -> None:
        options, name = sorted(known), str(name)  # which callers may have given as anything
        super().__init__(
            f"unknown {kind} {name!r:.200}.{did_you_mean(name, options)} "
            f"Known: {listed(name[:100], options)}.{' ' if hint else ''}{hint}"
        )


class SpecError(SwarmdataError, ValueError):
    """A TaskSpec or Recipe is malformed, contradicts itself or asks for something impossible."""


class SchemaError(SwarmdataError, ValueError):
    """An array or argument does not have the expected shape, dtype or range."""


class PolicyFitError(SchemaError):
    """A trained policy reads or commands something else than a task and its models offer."""


def check_type(
    name: str, value: object, kinds: type | tuple[type, ...], expected: str, advice: str = ""
) -> None:
    """Refuses an argument of another type than `kinds`.

    Args:
        name: of the argument.
        value: of the argument.
        kinds: that it may have.
        expected: what the caller may give, in words.
        advice: what to do instead, a sentence.

    Raises:
        SchemaError: it has another type.
    """
    if not isinstance(value, kinds):
        raise SchemaError(f"{name} is {value!r:.100}, expected {expected}. {advice}".strip())


def list_of(name: str, given: Any, expected: str, advice: str = "") -> list[Any]:
    """Returns an argument that is one name or path, or several, as a list.

    Raises:
        SchemaError: it holds something else; `expected` says in words what one may be.
    """
    found = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    for each in found:
        check_type(name, each, (str, Path), expected, advice)
    return found


class SpawnError(SwarmdataError, RuntimeError):
    """No collision-free layout was found for a spec in the allowed number of attempts."""


class CheckpointError(SwarmdataError, ValueError):
    """A checkpoint is malformed, or its hash is not the one that the recipe names."""


class MissingExtraError(SwarmdataError, ImportError):
    """An optional dependency is not installed; the message says how to install it."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs {package!r}, which is not installed. "
            f"Install it with: pip install 'swarmdata[{extra}]'"
        )


class ConversionError(SwarmdataError, ValueError):
    """Data in another format is ambiguous or inconsistent, or that format cannot hold the data."""


class ProgramError(SwarmdataError, OSError):
    """An external program, such as ffmpeg, is not installed or has failed."""


class DivergedError(SwarmdataError, ArithmeticError):
    """Training produced NaN or infinite values; the last checkpoint is from before that."""


class SimulationError(SwarmdataError, ArithmeticError):
    """A simulator could not go on with a world."""


class BuildError(SwarmdataError, RuntimeError):
    """A dataset could not be built; the parts that were finished are kept."""


class EngineError(BuildError):
    """An engine is unknown, or cannot be reached."""


class BatchError(BuildError):
    """Some items of a batch failed; the message names them, and the others are done."""


class RecipeConflictError(BuildError):
    """The build folder holds parts that were built from another recipe."""


class StudyError(SwarmdataError, RuntimeError):
    """A study, or one of its cells, could not be finished; finished cells are kept."""


class StaleCellError(StudyError):
    """A cell's folder holds results of another configuration, dataset or version."""


class FileKindError(SwarmdataError, OSError):
    """A file is not a regular file (a link, pipe or device), or is larger than allowed."""


class OutputError(SwarmdataError, FileExistsError):
    """A folder to write to has files in it that such a command did not write."""


class DiskFullError(SwarmdataError, OSError):
    """The disk or the quota was full while writing; files that were finished before are kept."""


class AddressError(SwarmdataError, ValueError):
    """The address of a remote, or the id of a dataset, is malformed."""


class GateError(SwarmdataError, ValueError):
    """A dataset does not meet the conditions for publication; the message lists every reason."""


class ResultsError(SwarmdataError, ValueError):
    """Results are out of date or cannot be combined; the message names every file."""


class HubError(SwarmdataError, OSError):
    """A remote could not be reached, refused a request, or returned invalid data."""


class AbsentFileError(HubError):
    """The remote has no such file."""


class ConflictError(HubError):
    """Another push to the same place came first; nothing of this push is visible."""


class VersionTakenError(HubError):
    """A different dataset is already published under this id and version, which never change."""


class DatasetError(SwarmdataError, OSError):
    """A stored dataset cannot be used."""


class DatasetNotFoundError(DatasetError):
    """There is no dataset at that path."""


class MissingManifestError(DatasetError):
    """The folder has no manifest: the dataset was never finished, or the file was lost."""


class ManifestError(DatasetError):
    """The manifest cannot be read, or contradicts itself or the arrays."""


class FormatVersionError(DatasetError):
    """The dataset has a newer format than this version of swarmdata can read; upgrade swarmdata."""


class MissingFileError(DatasetError):
    """A file or chunk that the manifest lists is missing."""


class TruncatedFileError(DatasetError):
    """A file does not have the size that the manifest lists."""


class ChecksumError(DatasetError):
    """A file's bytes have changed since it was written."""
