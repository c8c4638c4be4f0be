"""Parts of an unfinished dataset on a remote, for machines that share no file system.

Each is a tar file, `<id>.<recipe hash>.parts/policy-0-part-00003.<sha256>.tar`.
"""

import hashlib
import io
import re
import tarfile
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmdata.building.parts_folder import Parts
from swarmdata.errors import BuildError, ChecksumError, HubError
from swarmdata.hub.remotes.interface import PartRemote, Release, Remote
from swarmdata.runtime.atomic import new_folder

MAX_PART_BYTES = 1 << 34  # most bytes of one part that are fetched

_TAR = re.compile(r"(?P<part>policy-\d+-part-\d{5,})\.(?P<digest>[0-9a-f]{64})\.tar")
_FILE = re.compile(r"[a-z_]+\.npy")


class PartExchange:
    """The parts of one recipe, here and on a remote.

    Raises:
        HubError: the remote takes whole datasets only, or could not be asked.
        BuildError: it has two different copies of a part.
    """

    def __init__(self, parts: Parts, remote: Remote) -> None:
        if not isinstance(remote, PartRemote):
            raise HubError(
                f"{remote.address} takes whole datasets only. Let parts travel through a folder "
                "or a bucket, such as file:///folder or s3://bucket/prefix."
            )
        self.parts, self.remote = parts, remote
        self.box = f"{parts.recipe.id}.{parts.recipe.hash()[:12]}.parts"  # their folder there
        self.look()

    def look(self) -> None:
        """Asks the remote which parts it has."""
        self.there: dict[str, str] = {}  # name of a part -> its file
        for name in self.remote.part_files(self.box):
            match = _TAR.fullmatch(name)
            if match is None:
                continue
            if match["part"] in self.there:
                raise BuildError(
                    f"{self.remote.address}/{self.box} has two different copies of "
                    f"{match['part']}: machines with different versions of swarmdata, or without "
                    "exact arithmetic, have made them. Delete both, and make the part again."
                )
            self.there[match["part"]] = name

    def send(self) -> int:
        """Sends the parts that are here and not there; returns how many."""
        waiting = [path for path in self.parts.all() if path.name not in self.there]
        for path in waiting:
            content = _packed(path)
            name = f"{path.name}.{hashlib.sha256(content).hexdigest()}.tar"
            self.remote.send_part_file(self.box, name, content)
            self.there[path.name] = name
        return len(waiting)

    def receive(self, share: int = 1, n_shares: int = 1) -> int:
        """Fetches the parts of a share that are there and not here; returns how many.

        Raises:
            ChecksumError: a file is damaged.
            HubError: it could not be fetched.
        """
        here = {path.name for path in self.parts.all()}
        wanted = [
            part
            for part in sorted(self.there.keys() - here)
            if int(part.rpartition("-")[2]) % n_shares == share - 1
        ]
        for part in wanted:
            self._fetch(part)
        return len(wanted)

    def _fetch(self, part: str) -> None:
        name = self.there[part]
        release = Release(self.box, f"{self.remote.address}/{self.box}")
        with TemporaryDirectory(dir=self.parts.folder.parent) as scratch:
            file = Path(scratch) / name
            self.remote.read(release, name, file, MAX_PART_BYTES)
            content = file.read_bytes()
        if f"{part}.{hashlib.sha256(content).hexdigest()}.tar" != name:
            raise ChecksumError(
                f"{release.address}/{name} is damaged: its content has another SHA-256 than its "
                "name. Delete it there, and run the share again that made it."
            )
        _unpack(content, self.parts.folder / part)


def _packed(part: Path) -> bytes:
    """The files of a part as a tar file, the same bytes on every machine."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for file in sorted(part.iterdir()):
            entry = tarfile.TarInfo(file.name)  # no time and no owner
            entry.size = file.stat().st_size
            with file.open("rb") as opened:
                archive.addfile(entry, opened)
    return content.getvalue()


def _unpack(content: bytes, part: Path) -> None:
    """Writes a part, in one rename; nothing but its arrays is taken out of the file."""
    with (
        tarfile.open(fileobj=io.BytesIO(content), mode="r:") as archive,
        new_folder(part) as temporary,
    ):
        for entry in archive:
            opened = archive.extractfile(entry) if entry.isreg() else None
            if opened is None or not _FILE.fullmatch(entry.name):
                raise ChecksumError(f"{part.name} has {entry.name!r}, which no part has")
            (temporary / entry.name).write_bytes(opened.read())
