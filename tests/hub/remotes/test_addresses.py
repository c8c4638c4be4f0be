"""Addresses are read, refused and configured."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import AddressError, UnknownNameError
from swarmdata.hub.remotes.addresses import (
    REMOTES,
    Address,
    config_file,
    configured_remotes,
    open_remote,
    parse_address,
    store_remotes,
)
from tests.hub.remotes.conftest import ID


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("hf://org", Address("hf://org")),
        ("hf://org/", Address("hf://org")),
        ("hf://org/coop_nav-medium", Address("hf://org", "coop_nav-medium")),
        ("hf://org/coop_nav-medium@v1", Address("hf://org", "coop_nav-medium", "v1")),
        (f"hf://org/x-y@{'a' * 40}", Address("hf://org", "x-y", "a" * 40)),
        ("s3://bucket", Address("s3://bucket")),
        ("s3://bucket/a/b/", Address("s3://bucket/a/b")),
        (f"s3://bucket/a/{ID}", Address("s3://bucket/a", ID)),
        ("file:///a/b", Address("file:///a/b")),
        (f"file:///a/b/{ID}", Address("file:///a/b", ID)),
        ("https://host:8000/a", Address("https://host:8000/a")),
        (f"http://host/{ID}", Address("http://host", ID)),
        ("https://host/a@b", Address("https://host/a@b")),
        ("http://[::1]:8000/a", Address("http://[::1]:8000/a")),
        (f"https://[fd00::2]/a/{ID}", Address("https://[fd00::2]/a", ID)),
    ],
)
def test_addresses(text: str, expected: Address) -> None:
    assert parse_address(text) == expected
    assert parse_address(str(expected)) == expected


@pytest.mark.parametrize(
    "text",
    [
        "coop_nav-medium",
        "hf://",
        "hf:///name",
        "hf://org@v0",
        "hf://org/name@",
        "hf://org/a/b",
        "hf://or..g/name",
        "hf://org/../x",
        "hf://org/na me",
        "s3://",
        "s3:///prefix",
        "s3://bucket//x",
        "s3://bucket/../other",
        "s3://bucket/a?versionId=1",
        "file://relative/path",
        "file://",
        "https://host/a::s3://x",
        "https://[::1]/a::b",
        "https://[::1",
        "https://[::1::2]/a",
        "https://[host]/a",
        "s3://[::1]/a",
        "https://host:port/a",
        "https://host:99999/a",
        "https://höst/a",
        "https://host/a\\b",
        "https://host/\n",
    ],
)
def test_malformed_addresses(text: str) -> None:
    with pytest.raises(AddressError, match=r"[Ee]xpected|malformed"):
        parse_address(text)


@pytest.mark.parametrize(
    "text",
    [
        "https://me:s3cret@host/x", "https://me:s3cret@ho st/x", "https://me:s3cret@/x",
        "https://me:s3cret/x@host/x", "hf://me:s3cret@org", "hf://me:s3cret@org/name",
        "hf://me:s3cret/x@org", "s3://key:s3cret@bucket/x", "file://me:s3cret@host/x",
        "sftp://me:s3cret@host/x", "me:s3cret@host/x",
    ],
)  # fmt: skip
def test_passwords_are_refused_and_not_repeated(text: str) -> None:
    """Row 80: wherever they stand."""
    with pytest.raises((AddressError, UnknownNameError)) as caught:
        parse_address(text)
    assert "s3cret" not in str(caught.value)
    assert "s3cret" not in repr(caught.value)


def test_unknown_scheme() -> None:
    with pytest.raises(UnknownNameError, match="unknown kind of remote 'ftp'"):
        open_remote("ftp://host/x")
    with pytest.raises(UnknownNameError, match="Did you mean 's3'"):
        parse_address("s33://bucket")


@given(st.sampled_from(sorted(REMOTES)), st.text(max_size=30))
def test_any_text_is_an_address_or_one_error(scheme: str, rest: str) -> None:
    try:
        found = parse_address(f"{scheme}://{rest}")
    except (AddressError, UnknownNameError):
        return
    assert parse_address(str(found)) == found
    assert ".." not in str(found).split("/")


def test_a_dataset_is_not_a_remote() -> None:
    with pytest.raises(AddressError, match="expected a remote such as hf://org"):
        open_remote("hf://org/coop_nav-medium")
    assert open_remote("hf://org").address == "hf://org"


def test_configured_remotes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("SWARMDATA_REMOTES", raising=False)
    assert configured_remotes() == ()
    assert store_remotes(lambda there: (*there, "hf://org", "s3://bucket/p")) == config_file()
    assert configured_remotes() == ("hf://org", "s3://bucket/p")

    config_file().rename(tmp_path / "linked.yaml")
    config_file().symlink_to(tmp_path / "linked.yaml")
    assert store_remotes(lambda there: there[:1]) == tmp_path / "linked.yaml"
    assert config_file().is_symlink()
    assert configured_remotes() == ("hf://org",)

    monkeypatch.setenv("SWARMDATA_REMOTES", "s3://first/, hf://second, ")
    assert configured_remotes() == ("s3://first", "hf://second")
    monkeypatch.setenv("SWARMDATA_REMOTES", "")
    assert configured_remotes() == ()
    monkeypatch.setenv("SWARMDATA_REMOTES", "hf://org/coop_nav-medium")
    with pytest.raises(AddressError, match="SWARMDATA_REMOTES names"):
        configured_remotes()


@pytest.mark.parametrize("content", ["[", "remotes: 3", "- hf://org", "remotes: [1]", ""])
def test_broken_config(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: str) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("SWARMDATA_REMOTES", raising=False)
    store_remotes(lambda there: ())
    config_file().write_text(content)
    with pytest.raises(AddressError, match="Correct it, or move it away"):
        configured_remotes()
