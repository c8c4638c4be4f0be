"""check_remote, the contract of every kind of remote."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from swarmdata.errors import AbsentFileError, HubError, SwarmdataError, VersionTakenError
from swarmdata.hub.remotes.interface import RangeReader, Release, Remote
from swarmdata.hub.remotes.pull_dataset import pull
from swarmdata.store import read_manifest
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.testing.synthetic import RELEASE_CARD, write_release

FIRST_ID, NEXT_ID = "coop_nav-synthetic-v0", "coop_nav-synthetic-v1"
ABSENT_ID = "coop_nav-nobody_has_this-v0"
BESIDE = "more/table.csv"
"""A file that is published beside a dataset."""

N_THREADS = 4


def check_remote(remote: Remote, folder: Path | str, *, writer: Remote | None = None) -> None:
    """Checks every promise of `Remote`: two versions are published and fetched again.

    Args:
        remote: under test, of a place that has no dataset `coop_nav-synthetic` and may keep two.
        folder: an empty folder of this machine for what is published and fetched.
        writer: publishes to the same place, where `remote` is read only.

    Raises:
        AssertionError: a promise is broken.
    """
    folder = Path(folder)
    first = write_release(folder / "first", [30, 10, 70, 40, 20], FIRST_ID)
    other = write_release(folder / "other", [30, 10, 71, 40, 20], FIRST_ID)
    following = write_release(folder / "next", [30, 10, 72, 40, 20], NEXT_ID)
    beside = folder / "beside"
    (beside / BESIDE).parent.mkdir(parents=True)
    (beside / BESIDE).write_text("1,2\n")
    (beside / "README.md").write_text(RELEASE_CARD)  # whose tags a Hub lists datasets by
    publisher = remote if writer is None else writer
    check_absent(remote, FIRST_ID)
    if writer is not None:
        check_read_only(remote, first)
    release = check_publishing(remote, publisher, first, beside)
    check_reading(remote, release, first, folder / "read")
    check_published_stays(remote, publisher, release, first, other)
    publisher.publish(following, NEXT_ID, beside)
    check_versions(remote, release, first, following, folder / "pulled")
    check_absent(remote, ABSENT_ID)


def check_absent(remote: Remote, dataset_id: str) -> None:
    """What was not published is not found."""
    found = remote.find(dataset_id)
    assert found is None, f"find({dataset_id!r}) is {found}, not None: it was never published"
    assert dataset_id not in remote.ids(), f"ids() has {dataset_id!r}, which was never published"


def check_read_only(remote: Remote, dataset: Path) -> None:
    """A remote that cannot publish says so."""
    publish = partial(remote.publish, dataset, FIRST_ID)
    _check_refused(publish, HubError, "publish to a read only remote")
    check_absent(remote, FIRST_ID)


def check_publishing(remote: Remote, publisher: Remote, dataset: Path, beside: Path) -> Release:
    """A published dataset is found; one of another id than its manifest's is not published."""
    publish = partial(publisher.publish, dataset, NEXT_ID)
    _check_refused(publish, SwarmdataError, f"publishing the files of {FIRST_ID} as {NEXT_ID}")
    check_absent(remote, NEXT_ID)
    published = publisher.publish(dataset, FIRST_ID, beside)
    assert published.id == FIRST_ID, f"publish gave a release of {published.id}, not {FIRST_ID}"
    found = remote.find(FIRST_ID)
    assert found is not None, f"find({FIRST_ID!r}) is None after it was published"
    assert found.id == FIRST_ID, f"find({FIRST_ID!r}) gave a release of {found.id}"
    ids = remote.ids()
    assert FIRST_ID in ids, f"ids() is {ids}, without the published {FIRST_ID}"
    assert list(ids) == sorted(set(ids)), f"ids() is {ids}, not sorted or not unique"
    return found


def check_reading(remote: Remote, release: Release, dataset: Path, out: Path) -> None:
    """Every file arrives with its bytes, in several threads; what cannot leaves nothing."""
    out.mkdir()
    names = sorted(f.relative_to(dataset).as_posix() for f in dataset.rglob("*") if f.is_file())

    def fetch(number: int) -> None:
        file = dataset / names[number]
        remote.read(release, names[number], out / str(number), file.stat().st_size)

    with ThreadPoolExecutor(N_THREADS) as pool:
        list(pool.map(fetch, range(len(names))))
    for number, name in enumerate(names):
        assert (out / str(number)).read_bytes() == (dataset / name).read_bytes(), (
            f"read gave other bytes of {name} than were published"
        )
    try:
        remote.read(release, BESIDE, out / "beside", 100)
    except Exception as error:
        raise AssertionError(
            f"reading {BESIDE}, published beside the dataset: {error!r}"
        ) from error
    assert (out / "beside").read_text() == "1,2\n", f"read gave other bytes of {BESIDE}"
    absent = partial(remote.read, release, "nothing.txt", out / "x", 100)
    _check_refused(absent, AbsentFileError, "reading a file that is not there")
    if isinstance(remote, RangeReader):
        check_ranges(remote, release, dataset, names)
    too_large = partial(remote.read, release, MANIFEST, out / "x", 10)
    _check_refused(too_large, HubError, "reading more bytes than are wanted")
    assert not (out / "x").exists(), "a failed read left a file at `out`"


def check_ranges(
    remote: RangeReader, release: Release, dataset: Path, names: Sequence[str]
) -> None:
    """Parts of files have the bytes that the whole files have there."""
    for name in names:
        whole = (dataset / name).read_bytes()
        middle = len(whole) // 2
        for first, size in ((0, 1), (middle, len(whole) - middle), (0, len(whole))):
            assert remote.read_range(release, name, first, size) == whole[first : first + size], (
                f"read_range({name!r}, {first}, {size}) gave other bytes than were published"
            )
    absent = partial(remote.read_range, release, "nothing.txt", 0, 1)
    _check_refused(absent, AbsentFileError, "reading a part of a file that is not there")


def check_published_stays(
    remote: Remote, publisher: Remote, release: Release, dataset: Path, other: Path
) -> None:
    """The same files again change nothing, and other files of the same id are refused."""
    again = publisher.publish(dataset, FIRST_ID)
    assert again.id == FIRST_ID, f"publishing the same again gave a release of {again.id}"
    assert remote.find(FIRST_ID) == release, "publishing the same files again changed the release"
    publish = partial(publisher.publish, other, FIRST_ID)
    _check_refused(publish, VersionTakenError, "publishing another dataset of a published id")
    assert remote.find(FIRST_ID) == release, "a refused dataset changed the published release"


def check_versions(
    remote: Remote, release: Release, dataset: Path, following: Path, out: Path
) -> None:
    """Two published versions are there side by side, and each is pulled whole."""
    ids = remote.ids()
    assert {FIRST_ID, NEXT_ID} <= set(ids), f"ids() is {ids} with two published versions"
    found = remote.find(NEXT_ID)
    assert found is not None, f"find({NEXT_ID!r}) is None after it was published"
    for each, source in ((release, dataset), (found, following)):
        pulled = pull(remote, each, out / each.id, progress=False)
        for name in (MANIFEST, *read_manifest(source).files):
            assert (pulled / name).read_bytes() == (source / name).read_bytes(), (
                f"{name} of {each.id} has other bytes when it is pulled"
            )


def _check_refused(act: Callable[[], object], kind: type[SwarmdataError], what: str) -> None:
    """Checks that an act raises an error of a kind."""
    try:
        act()
    except Exception as error:  # whatever a remote of others raises is reported
        assert isinstance(error, kind), f"{what}: {error!r}, no {kind.__name__}"  # noqa: PT017
    else:
        raise AssertionError(f"{what}: no {kind.__name__}")
