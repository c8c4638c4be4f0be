"""Episodes become files, with rays and messages where the models have them."""

from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SchemaError, SpecError
from swarmdata.evaluation.results import clips
from swarmdata.evaluation.results.clips import draw_target, write_clip
from swarmdata.registry.components import make_env, make_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode

pil = pytest.importorskip("PIL.Image", reason="Pillow draws")


def play(spec: TaskSpec) -> Episode:
    policy = make_policy("random", spec)
    (episode,) = rollout(make_env(spec), policy, np.array([3], dtype=np.uint64))
    return episode


def test_png_shows_more_with_rays_and_messages(tmp_path: Path) -> None:
    base = TaskSpec(horizon=20)
    pictures = []
    for name, models in {
        "plain": (None, None), "rays": ("lidar", None), "radio": ("lidar", "lossy-40")
    }.items():  # fmt: skip
        observation, communication = models
        spec = with_models(base, observation, communication)
        out = tmp_path / "deep" / f"{name}.png"
        write_clip(play(spec), spec, out)
        pictures.append(np.asarray(pil.open(out).convert("RGB")))
    assert pictures[0].shape == pictures[1].shape == pictures[2].shape
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[1] != pictures[2]).any()


def test_gif_moves(tmp_path: Path) -> None:
    spec = with_models(TaskSpec(horizon=4), "lidar+stack-2", "perfect")
    write_clip(play(spec), spec, tmp_path / "x.GIF", size=96)
    with pil.open(tmp_path / "x.GIF") as image:
        assert image.n_frames == 5


def test_a_recorded_episode_is_drawn_as_other_robots_would_have_seen_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Recorded(list[Episode]):
        task = TaskSpec(horizon=20)
        id = "coop_nav-recorded-v0"

    episode = play(Recorded.task)
    monkeypatch.setattr(clips, "find_dataset", str)
    monkeypatch.setattr(clips, "load", lambda _: Recorded([episode]))
    seen = draw_target("x", tmp_path / "seen.png", 0, None, "lidar", "lossy-40")
    plain = draw_target("x", tmp_path / "plain.png", 0, None)

    with pytest.raises(SpecError, match="drawn as recorded, not simulated in mujoco"):
        draw_target("x", tmp_path / "x.png", 0, None, backend="mujoco")

    live = play(with_models(Recorded.task, "lidar", "lossy-40"))
    np.testing.assert_array_equal(seen.observations, live.observations)
    np.testing.assert_array_equal(plain.observations, episode.observations)
    assert (tmp_path / "seen.png").read_bytes() != (tmp_path / "plain.png").read_bytes()
    with pytest.raises(SchemaError, match="has 1 episodes, none numbered 1"):
        draw_target("x", tmp_path / "x.png", 1, None)


def test_other_files_are_refused(tmp_path: Path) -> None:
    spec = TaskSpec(horizon=5)
    with pytest.raises(SchemaError, match=r"expected a file that ends in .*\.png"):
        write_clip(play(spec), spec, tmp_path / "x.bmp")
