"""Every error that swarmdata raises on purpose.

SwarmdataError
├── UnknownNameError (KeyError)         a registry or the catalog has no such name
├── SpecError (ValueError)              a spec is malformed or asks for what there is not
├── SchemaError (ValueError)            arrays do not have the promised shape, dtype or range
├── SpawnError (RuntimeError)           no collision-free layout could be drawn for this spec
├── CheckpointError (ValueError)        a checkpoint is not the one the recipe names
├── MissingExtraError (ImportError)     an optional dependency is needed and absent
├── ConversionError (ValueError)        data of another format is ambiguous or broken
├── ProgramError (OSError)              another program, such as ffmpeg, is absent or has failed
├── DivergedError (ArithmeticError)     training became infinite or NaN; the checkpoint is kept
├── BuildError (RuntimeError)           a dataset could not be made
│   └── RecipeConflictError             the folder holds parts of another recipe
├── StudyError (RuntimeError)           a study, or a cell of it, could not be finished
│   └── StaleCellError                  a cell's folder holds results of another configuration
├── FileKindError (OSError)             a named file is no regular file, or is too large
├── DiskFullError (OSError)             no space was left; what was finished before is kept
├── AddressError (ValueError)           an address or a dataset's id is malformed
├── GateError (ValueError)              a dataset may not be published
├── ResultsError (ValueError)           results are stale, or do not belong together
├── HubError (OSError)                  a remote could not be asked, or refused
│   ├── AbsentFileError                 the remote has no such file
│   ├── ConflictError                   someone else published there meanwhile
│   └── VersionTakenError               this version is published already, and never changes
└── DatasetError (OSError)              a stored dataset cannot be used
    ├── DatasetNotFoundError            there is nothing at that path
    ├── MissingManifestError            the folder has no manifest, so it was never finished
    ├── ManifestError                   the manifest cannot be read or contradicts itself
    ├── FormatVersionError              written by a newer swarmdata
    ├── MissingFileError                a listed file or chunk is absent
    ├── TruncatedFileError              a file is shorter or longer than listed
    └── ChecksumError                   the bytes are not those that were written
"""

import difflib
from collections.abc import Iterable


class SwarmdataError(Exception):
    """Base class of every error this library raises on purpose."""

    def __str__(self) -> str:
        """The message itself; `KeyError` would otherwise show it quoted."""
        return str(self.args[0]) if self.args else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Returns " Did you mean 'x'?" for the nearest known name, or an empty string."""
    near = difflib.get_close_matches(name[:100], list(known), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


class UnknownNameError(SwarmdataError, KeyError):
    """A registry or the catalog was asked for a name that it does not hold."""

    def __init__(self, kind: str, name: str, known: Iterable[str], hint: str = "") -> None:
        options = sorted(known)
        known_names = ", ".join(options)
        super().__init__(
            f"unknown {kind} {name!r:.200}.{did_you_mean(name, options)} Known: {known_names}."
            f"{' ' if hint else ''}{hint}"
        )


class SpecError(SwarmdataError, ValueError):
    """A TaskSpec or Recipe is malformed, or asks for something that is not available."""


class SchemaError(SwarmdataError, ValueError):
    """Arrays do not have the shape, dtype or range that was promised."""


class SpawnError(SwarmdataError, RuntimeError):
    """No collision-free layout could be drawn for this spec."""


class CheckpointError(SwarmdataError, ValueError):
    """A checkpoint is malformed or is not the one that the recipe names."""


class MissingExtraError(SwarmdataError, ImportError):
    """An optional dependency is needed and absent."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs {package!r}, which is not installed. "
            f"Install it with: pip install 'swarmdata[{extra}]'"
        )


class ConversionError(SwarmdataError, ValueError):
    """Data of another format is ambiguous, does not fit together, or cannot hold what is asked."""


class ProgramError(SwarmdataError, OSError):
    """Another program, such as ffmpeg, is needed and absent, or has failed."""


class DivergedError(SwarmdataError, ArithmeticError):
    """Training left the finite numbers; the last checkpoint is of before."""


class BuildError(SwarmdataError, RuntimeError):
    """A dataset could not be made; finished parts are kept."""


class RecipeConflictError(BuildError):
    """The build folder holds parts of another recipe."""


class StudyError(SwarmdataError, RuntimeError):
    """A study, or a cell of it, could not be finished; what is done is kept."""


class StaleCellError(StudyError):
    """A cell's folder holds results of another configuration, dataset or version."""


class FileKindError(SwarmdataError, OSError):
    """A file that somebody named is no regular file, or is larger than such a file may be."""


class DiskFullError(SwarmdataError, OSError):
    """No space was left while writing; what was finished before is kept."""


class AddressError(SwarmdataError, ValueError):
    """An address of a remote, or the id of a dataset, is malformed."""


class GateError(SwarmdataError, ValueError):
    """A dataset may not be published; the message lists every reason."""


class ResultsError(SwarmdataError, ValueError):
    """Results are stale, or do not belong together; the message names every file."""


class HubError(SwarmdataError, OSError):
    """A remote could not be asked, refused, or gave what it must not give."""


class AbsentFileError(HubError):
    """The remote has no such file."""


class ConflictError(HubError):
    """Someone else published to the same place meanwhile; nothing of this push is visible."""


class VersionTakenError(HubError):
    """Another dataset is published under this id and version, which never changes."""


class DatasetError(SwarmdataError, OSError):
    """A stored dataset cannot be used."""


class DatasetNotFoundError(DatasetError):
    """There is no dataset at that path."""


class MissingManifestError(DatasetError):
    """The folder has no manifest: the dataset was never finished, or the file was lost."""


class ManifestError(DatasetError):
    """The manifest cannot be read, or contradicts itself or the arrays."""


class FormatVersionError(DatasetError):
    """The dataset was written in a format newer than this library reads."""


class MissingFileError(DatasetError):
    """A file or chunk that the manifest lists is absent."""


class TruncatedFileError(DatasetError):
    """A file does not have the size that the manifest lists."""


class ChecksumError(DatasetError):
    """The stored bytes are not those that were written."""
