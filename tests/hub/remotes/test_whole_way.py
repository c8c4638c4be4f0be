"""A user's data all the way: recorded, audited, pushed, pulled elsewhere, learned from."""

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the torch extra")
pytest.importorskip("mpe2", reason="records simple_spread_v3 of mpe2")

import swarmdata
from swarmdata.audit import audit
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.interface import Release
from tests.examples import record_simple_spread as example
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.support.command_line import run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning"),  # the client's
]


def test_a_recording_is_shared_and_learned_from(
    hub: LoopbackHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded = example.record(tmp_path / example.ID, 60)
    assert audit(recorded.path).problems == ()

    run("push", recorded.path, "hf://org")
    main = hub.repositories["org/simple_spread_v3-mixed"].main
    assert {"README.md", "card.md", "croissant.json", "episodes.parquet"} <= main.keys()

    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "elsewhere"))
    pulled = swarmdata.load("hf://org/simple_spread_v3-mixed@v0")
    assert pulled.digest == recorded.digest
    assert pulled.source.startswith("hf://org/simple_spread_v3-mixed@")
    assert swarmdata.load("hf://org/simple_spread_v3-mixed@v0", offline=True).source == "cache"

    release = Release(example.ID, pulled.source)
    open_remote("hf://org").read(release, "README.md", tmp_path / "README.md", 1 << 20)
    assert "config_name: episodes" in (tmp_path / "README.md").read_text()

    policies = example.train(pulled.path, tmp_path / "run", n_updates=400)
    assert min(example.play(policies, example.spec_of(pulled), 10)) > example.play_random(10)
