"""A Hugging Face Hub on 127.0.0.1, for the true client: repositories, commits, tags, large files.

It speaks what huggingface_hub 0.34 to 2.x asks for when datasets are pushed, listed and pulled.
With a `cas` folder, large files go through the real xet client, which keeps them in that folder.
"""

import base64
import contextlib
import hashlib
import json
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import yaml

from tests.hub.remotes.faults import FaultyHandler, FaultyServer


@dataclass(frozen=True)
class Blob:
    """One file of a commit: its bytes, or the SHA-256 of a large one."""

    size: int
    oid: str
    data: bytes | None = None
    sha256: str | None = None


Files = dict[str, Blob]


@dataclass
class Repository:
    """Commits by id, branches and tags."""

    commits: dict[str, Files] = field(default_factory=dict)
    titles: list[str] = field(default_factory=list)
    branches: dict[str, str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)

    def commit(self, files: Files, title: str) -> str:
        """Adds a commit to main."""
        content = repr((sorted((k, v.oid) for k, v in files.items()), title, len(self.commits)))
        commit = hashlib.sha1(content.encode()).hexdigest()
        self.commits[commit] = files
        self.titles.append(title)
        self.branches["main"] = commit
        return commit

    def resolve(self, revision: str) -> str | None:
        """The commit of a branch, a tag or a commit."""
        known = {**self.tags, **self.branches}
        return known.get(revision, revision if revision in self.commits else None)

    @property
    def main(self) -> Files:
        """The files on main."""
        return self.commits[self.branches["main"]]


def git_oid(data: bytes) -> str:
    """The SHA-1 that git gives a file."""
    return hashlib.sha1(b"blob %d\0" % len(data) + data).hexdigest()


class LoopbackHub(FaultyServer):
    """The hub.

    Args:
        cas: folder for the xet client; None: large files go through LFS.
        large: bytes from which on a file is large.
    """

    def __init__(self, cas: Path | None = None, large: int = 2_000) -> None:
        super().__init__(_Handler)
        self.repositories: dict[str, Repository] = {}
        self.large, self.cas = large, cas
        self.lfs: dict[str, bytes] = {}
        self.xet: dict[str, str] = {}  # xet hash by SHA-256
        self.extra_names: list[str] = []  # put into every listing

    def register_xet(self, path: Path) -> None:
        """Tells the hub the xet hash of a file, which a real one computes itself."""
        import hf_xet

        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        self.xet[digest] = hf_xet.hash_files([str(path)])[0].hash


class _Handler(FaultyHandler):
    server: LoopbackHub

    def answer(self) -> None:
        body, url = self.read_body(), urlsplit(self.path)
        changes = self.command in ("POST", "PUT")  # what only reads may be slow beside others
        with self.server.lock if changes else contextlib.nullcontext():
            for method, pattern, handle in _ROUTES:
                match = re.fullmatch(pattern, url.path)
                if match and method in (self.command, "*"):
                    parts = [unquote(part) for part in match.groups()]
                    handle(self, body, *parts)
                    return
        self.send_json(404, {"error": f"unhandled {self.command} {self.path}"})

    def send_json(self, status: int, content: Any, headers: dict[str, str] | None = None) -> None:
        self.send(status, json.dumps(content).encode(), headers)

    def refuse(self, status: int, code: str) -> None:
        self.send_json(status, {"error": code}, {"X-Error-Code": code, "X-Error-Message": code})

    def whoami(self, body: bytes) -> None:
        role = {"accessToken": {"role": "write"}, "type": "access_token"}
        self.send_json(200, {"type": "user", "name": "org", "orgs": [], "auth": role})

    def validate(self, body: bytes) -> None:
        self.send_json(200, {"errors": [], "warnings": []})

    def create(self, body: bytes) -> None:
        asked = json.loads(body)
        name = f"{asked.get('organization') or 'org'}/{asked['name']}"
        status = 409 if name in self.server.repositories else 200
        if status == 200:
            self.server.repositories[name] = made = Repository()
            attributes = b"*.bin filter=lfs\n"
            blob = Blob(len(attributes), git_oid(attributes), attributes)
            made.commit({".gitattributes": blob}, "initial commit")
        self.send_json(status, {"url": f"{self.server.url}/datasets/{name}", "name": name})

    def listing(self, body: bytes) -> None:
        query = parse_qs(urlsplit(self.path).query)
        author, wanted = query["author"][0], query.get("filter", [None])[0]
        names = [
            name
            for name, repository in self.server.repositories.items()
            if name.startswith(f"{author}/") and wanted in (None, *_card_tags(repository.main))
        ]
        self.send_json(200, [{"id": name, "_id": name, "tags": []} for name in names])

    def info(self, body: bytes, name: str, revision: str = "main") -> None:
        found = self._find(name, revision)
        if found is None:
            return
        repository, commit = found
        siblings = [_sibling(path, blob) for path, blob in repository.commits[commit].items()]
        siblings += [_sibling(path, Blob(1, "0" * 40, b"x")) for path in self.server.extra_names]
        content: dict[str, Any] = {"_id": name, "id": name, "sha": commit, "tags": []}
        content["siblings"] = siblings
        content["xetEnabled"] = self.server.cas is not None  # which versions below 1 ask for
        self.send_json(200, content)

    def refs(self, body: bytes, name: str) -> None:
        if name not in self.server.repositories:
            self.refuse(404, "RepoNotFound")
            return
        repository = self.server.repositories[name]

        def listed(kind: str, known: dict[str, str]) -> list[dict[str, str]]:
            return [
                {"name": key, "ref": f"refs/{kind}/{key}", "targetCommit": value}
                for key, value in known.items()
            ]

        branches, tags = listed("heads", repository.branches), listed("tags", repository.tags)
        self.send_json(200, {"branches": branches, "tags": tags, "converts": []})

    def preupload(self, body: bytes, name: str, revision: str) -> None:
        found = self._find(name, revision)
        if found is None:
            return
        repository, commit = found
        there, answers = repository.commits[commit], []
        for file in json.loads(body)["files"]:
            mode = "lfs" if file["size"] >= self.server.large else "regular"
            answer = {"path": file["path"], "uploadMode": mode, "shouldIgnore": False}
            if file["path"] in there:
                blob = there[file["path"]]
                answer["oid"] = blob.sha256 or blob.oid
            answers.append(answer)
        self.send_json(200, {"files": answers})

    def batch(self, body: bytes, name: str) -> None:
        question, answers = json.loads(body), []
        offered = self.server.cas is not None and "xet" in question.get("transfers", [])
        for asked in question["objects"]:
            answer: dict[str, Any] = {"oid": asked["oid"], "size": asked["size"]}
            if asked["oid"] not in self.server.lfs:
                upload = {"href": f"{self.server.url}/_lfs/{asked['oid']}", "header": {}}
                answer["actions"] = {"upload": upload}
            answers.append(answer)
        kind = {"Content-Type": "application/vnd.git-lfs+json"}
        transfer = "xet" if offered else "basic"
        self.send_json(200, {"transfer": transfer, "objects": answers}, kind)

    def store(self, body: bytes, oid: str) -> None:
        if hashlib.sha256(body).hexdigest() != oid:
            self.send_json(400, {"error": "wrong SHA-256"})
            return
        self.server.lfs[oid] = body
        self.send(200, b"", {"ETag": f'"{oid}"'})

    def fetch(self, body: bytes, oid: str) -> None:
        self.send_file(self.server.lfs[oid], {"ETag": f'"{oid}"', "Accept-Ranges": "bytes"})

    def xet_token(self, body: bytes, name: str, kind: str, revision: str) -> None:
        cas, expires = f"local://{self.server.cas}", int(time.time()) + 3600
        headers = {
            "X-Xet-Cas-Url": cas,
            "X-Xet-Access-Token": "t",
            "X-Xet-Token-Expiration": str(expires),
        }
        self.send_json(200, {"casUrl": cas, "accessToken": "t", "exp": expires}, headers)

    def commit(self, body: bytes, name: str, revision: str) -> None:
        found = self._find(name, revision)
        if found is None:
            return
        repository, head = found
        files, title = dict(repository.commits[head]), ""
        for line in body.decode().splitlines():
            item = json.loads(line)
            key, value = item["key"], item["value"]
            if key == "header":
                title = value["summary"]
                if value.get("parentCommit", head) != head:
                    self.send_json(412, {"error": "a commit has happened since"})
                    return
            elif key == "file":
                data = base64.b64decode(value["content"])
                files[value["path"]] = Blob(len(data), git_oid(data), data)
            elif key == "lfsFile":
                if value["oid"] not in self.server.lfs and self.server.cas is None:
                    self.send_json(400, {"error": "large file is missing"})
                    return
                files[value["path"]] = Blob(value["size"], "1" * 40, None, value["oid"])
            elif key == "deletedFile":
                files.pop(value["path"], None)
        commit = repository.commit(files, title)
        url = f"{self.server.url}/datasets/{name}/commit/{commit}"
        self.send_json(200, {"success": True, "commitOid": commit, "commitUrl": url})

    def tag(self, body: bytes, name: str, revision: str) -> None:
        found = self._find(name, revision)
        if found is None:
            return
        repository, commit = found
        tag = json.loads(body)["tag"]
        if tag in repository.tags:
            self.send_json(409, {"error": "the tag is there"})
            return
        repository.tags[tag] = commit
        self.send(201, b"{}")

    def resolve(self, body: bytes, name: str, revision: str, path: str) -> None:
        found = self._find(name, revision)
        if found is None:
            return
        repository, commit = found
        blob = repository.commits[commit].get(path)
        if blob is None:
            self.refuse(404, "EntryNotFound")
            return
        headers = {"X-Repo-Commit": commit, "Accept-Ranges": "bytes"}
        if blob.data is not None:
            self.send_file(blob.data, {**headers, "ETag": f'"{blob.oid}"'})
            return
        assert blob.sha256 is not None
        # another host name: the client follows redirects to the same one, and misses headers then
        large = {
            "Location": f"http://localhost:{self.server.server_port}/_lfs/{blob.sha256}",
            "X-Linked-Etag": f'"{blob.sha256}"',
            "X-Linked-Size": str(blob.size),
        }
        if blob.sha256 in self.server.xet:
            token = f"{self.server.url}/api/datasets/{name}/xet-read-token/{commit}"
            large["X-Xet-Hash"] = self.server.xet[blob.sha256]
            large["X-Xet-Refresh-Route"] = token
        self.send(302, b"", {**headers, **large})

    def _find(self, name: str, revision: str) -> tuple[Repository, str] | None:
        """The repository and commit, or an answer that there is none."""
        repository = self.server.repositories.get(name)
        if repository is None:
            self.refuse(404, "RepoNotFound")
            return None
        commit = repository.resolve(revision)
        if commit is None:
            self.refuse(404, "RevisionNotFound")
            return None
        return repository, commit


def _sibling(path: str, blob: Blob) -> dict[str, Any]:
    entry: dict[str, Any] = {"rfilename": path, "size": blob.size, "blobId": blob.oid}
    if blob.sha256 is not None:
        entry["lfs"] = {"sha256": blob.sha256, "size": blob.size, "pointerSize": 130}
    return entry


def _card_tags(files: Files) -> list[str]:
    readme = files.get("README.md")
    if readme is None or readme.data is None or not readme.data.startswith(b"---\n"):
        return []
    front = readme.data.decode().split("---\n")[1]
    return list(yaml.safe_load(front).get("tags", []))


_NAME, _PART = r"([^/]+/[^/]+)", r"([^/]+)"

_ROUTES: tuple[tuple[str, str, Callable[..., None]], ...] = (
    ("GET", "/api/whoami-v2", _Handler.whoami),
    ("POST", "/api/validate-yaml", _Handler.validate),
    ("POST", "/api/repos/create", _Handler.create),
    ("GET", "/api/datasets", _Handler.listing),
    ("GET", f"/api/datasets/{_NAME}/refs", _Handler.refs),
    ("GET", f"/api/datasets/{_NAME}/revision/{_PART}", _Handler.info),
    ("GET", f"/api/datasets/{_NAME}/xet-(read|write)-token/{_PART}", _Handler.xet_token),
    ("POST", f"/api/datasets/{_NAME}/preupload/{_PART}", _Handler.preupload),
    ("POST", f"/api/datasets/{_NAME}/commit/{_PART}", _Handler.commit),
    ("POST", f"/api/datasets/{_NAME}/tag/{_PART}", _Handler.tag),
    ("GET", f"/api/datasets/{_NAME}", _Handler.info),
    ("POST", f"/datasets/{_NAME}.git/info/lfs/objects/batch", _Handler.batch),
    ("PUT", "/_lfs/([0-9a-f]{64})", _Handler.store),
    ("*", "/_lfs/([0-9a-f]{64})", _Handler.fetch),
    ("*", f"/datasets/{_NAME}/resolve/{_PART}/(.+)", _Handler.resolve),
)
