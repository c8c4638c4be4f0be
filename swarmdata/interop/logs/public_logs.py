"""Public logs of robots: where they are, under which terms, and the dataset that they give.

Most may not be passed on, so the package has addresses, digests, maps and the dataset's digest.
"""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    ChecksumError,
    ConversionError,
    HubError,
    OutputError,
    SpecError,
    UnknownNameError,
)
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.pull_dataset import difference, fetch_checked
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.runtime.atomic import staged
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.runtime.output_folder import check_marked
from swarmdata.runtime.regular_files import check_regular
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import Sha256, Text
from swarmdata.specs.recipe import Id
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.manifest import FileEntry, read_manifest


class PublicLogs(Frozen):
    """A recipe: public logs, and the dataset that they become."""

    title: Text
    source: Text  # page of those who made them
    license: Text  # as found there; "none stated"
    citation: Text
    address: Text  # of the folder that has the files, which never change there
    files: Annotated[dict[Text, FileEntry], Field(min_length=1)]  # by their names
    map: Text  # of the package, by its name
    id: Id  # of the dataset
    digest: Sha256  # likewise

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(entry.size for entry in self.files.values())

    @property
    def terms(self) -> str:
        """What to know before fetching them."""
        return (
            f"{self.title}\nsource: {self.source}\nfiles: {len(self.files)}, {self.size:,} bytes, "
            f"from {self.address}\nlicence: {self.license}\ncite: {self.citation}"
        )


def public_logs() -> dict[str, PublicLogs]:
    """The recipes of the package, by name."""
    folder = Path(__file__).parent / "sources"
    return {path.stem: PublicLogs.from_file(path) for path in sorted(folder.glob("*.yaml"))}


def find_public_logs(name: str) -> PublicLogs:
    """The recipe of a name, or UnknownNameError."""
    known = public_logs()
    if name not in known:
        raise UnknownNameError("public logs", name, known)
    return known[name]


def fetch_logs(
    name: str,
    out: Path | str | None = None,
    *,
    accept_terms: bool = False,
    source: Path | str | None = None,
) -> Dataset:
    """Makes the dataset of public logs: fetches them, imports them, and audits the result.

    An interrupted download goes on when it is called again.

    Args:
        name: such as `mrclam-6`; `swarmdata fetch` lists all.
        out: folder of the dataset; None: in the cache, where `load` finds it by its id.
        accept_terms: whether you accept the terms, which are printed without it.
        source: folder to which you have downloaded the files yourself; None: they are fetched.

    Raises:
        UnknownNameError: there are no such logs.
        SpecError: the terms are not accepted.
        HubError: a file could not be fetched.
        ChecksumError: a file or the dataset has another digest than the recipe.
        ConversionError: a file is not in `source`.
        OutputError: something else is at `out`.
    """
    logs = find_public_logs(name)
    if not accept_terms:
        raise SpecError(
            f"{logs.terms}\nNothing was fetched: pass accept_terms=True (--accept-terms) if you "
            "accept these terms"
        )
    folder = cache_folder() / "datasets" / logs.id if out is None else Path(out).expanduser()
    folder = folder.absolute()
    check_marked(folder, MANIFEST, "dataset")
    if (folder / MANIFEST).exists():
        if read_manifest(folder).digest != logs.digest:
            raise OutputError(
                f"{folder} has another dataset than {logs.id} of the digest {logs.digest}. Choose "
                "another folder, or move it away."
            )
        return Dataset.open(folder)
    files = _fetched(logs, name) if source is None else _given(logs, Path(source).expanduser())
    with staged(folder) as made:
        import_logs(
            files, made, log_map=logs.map, id=logs.id,
            metadata={"license": logs.license, "source": logs.source, "citation": logs.citation},
        )  # fmt: skip
        _check(made, logs)
    return Dataset.open(folder)


def _fetched(logs: PublicLogs, name: str) -> list[Path]:
    """The files in the cache; those that are not there are fetched."""
    remote, folder = open_remote(logs.address), cache_folder() / "logs" / name
    for file, entry in logs.files.items():
        path = folder / file
        if path.is_file() and difference(path, entry) is None:
            continue
        try:
            fetch_checked(remote, Release(logs.id, logs.address), file, entry, path)
        except HubError as error:
            raise type(error)(
                f"{error} Files that you have from elsewhere, such as {logs.source}, are taken "
                "with --from FOLDER."
            ) from error
    return [folder / file for file in logs.files]


def _given(logs: PublicLogs, folder: Path) -> list[Path]:
    """The files that a user has downloaded."""
    for file, entry in logs.files.items():
        path = folder / file
        if not path.exists():
            raise ConversionError(
                f"{folder} has no {file}, expected {', '.join(logs.files)} from {logs.address}"
            )
        check_regular(path)
        if problem := difference(path, entry):
            raise ChecksumError(
                f"{path} is another file than that at {logs.address}: {problem}. Other copies "
                f"become datasets of their own: swarmdata import {folder} --map {logs.map} --id ID."
            )
    return [folder / file for file in logs.files]


def _check(folder: Path, logs: PublicLogs) -> None:
    """Checks a new dataset before anybody sees it."""
    found = audit(folder, progress=False)
    if found.digest != logs.digest or found.problems:
        problems = "; ".join(each.message for each in found.problems)
        raise ChecksumError(
            f"the logs gave a dataset of the digest {found.digest}, expected {logs.digest}"
            f"{problems and f', with problems: {problems}'}. It was thrown away: this version of "
            "swarmdata, or of NumPy, computes other bits. `swarmdata import` makes it without a "
            "recipe."
        )
