"""Arrays of other environments as lines, and images as images."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.catalogue.replays.series_columns import IMAGE_SIDE, N_LEVELS, SeriesColumns
from swarmdata.record import Recorder
from tests.record.worlds import Counting, play
from tests.support.image_world import LENGTH, SHAPE, record_images


def test_lines_are_right_to_a_thousandth_of_their_range(tmp_path: Path) -> None:
    with Recorder(Counting(), id="counting_v1-mine-v0", path=tmp_path / "ds") as recorder:
        play(recorder, 3)
    dataset = recorder.close()
    episodes = list(dataset)
    columns = SeriesColumns(dataset.spec, episodes)
    described = columns.describe()

    codes = columns.moving(episodes[0])

    low, high = np.array(described["low"]), np.array(described["high"])
    values = low + codes * (high - low) / N_LEVELS
    assert [name for name, *_ in described["panels"]] == ["reward", "action", "observation"]
    assert (codes[0, :2] == -1).all()  # no reward led to the first state
    np.testing.assert_allclose(values[1:, :2], episodes[0].rewards, atol=0.01)
    assert codes.max() <= N_LEVELS


def test_images_are_shown_as_images(tmp_path: Path) -> None:
    dataset = record_images(tmp_path / "ds")
    columns = SeriesColumns(dataset.spec, list(dataset))

    states, pixels = columns.images(dataset[0])

    assert columns.image_shape == SHAPE
    assert states.tolist() == list(range(LENGTH + 1))
    shown = pixels.reshape(len(states), 2, *SHAPE)
    assert (shown[5, 0, 4:8, 5:9, 0] == 255).all()
    assert (shown[5, 1, 4:8, 5:9, 1] == 255).all()
    assert [name for name, *_ in columns.describe()["panels"]] == ["reward", "action"]


def test_values_that_are_not_finite_have_a_code_of_their_own(tmp_path: Path) -> None:
    dataset = record_images(tmp_path / "ds", 1)
    rewards = dataset[0].rewards.copy()
    rewards[2, 0], rewards[3, 0], rewards[:, 1] = np.nan, np.inf, np.nan
    episode = replace(dataset[0], rewards=rewards)
    columns = SeriesColumns(dataset.spec, [episode])

    codes = columns.moving(episode)

    assert codes[:, 0].tolist() == [-1, 0, 500, -1, -1, 500, 1000, 0, 500, 1000]
    assert (codes[:, 1] == -1).all()
    assert columns.describe()["low"][1] == 0.0


@pytest.mark.parametrize(("side", "shown"), [(20, 20), (96, IMAGE_SIDE)])
def test_large_images_are_shrunk(tmp_path: Path, side: int, shown: int) -> None:
    dataset = record_images(tmp_path / "ds", 1)
    columns = SeriesColumns(dataset.spec, list(dataset))
    columns.image_shape = (side, side // 2, 3)

    assert columns.shown_shape == (shown, shown // 2)
