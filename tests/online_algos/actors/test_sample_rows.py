"""Samples as rows of stacked networks."""

import numpy as np
import torch

from swarmdata.online_algos.actors.sample_rows import pick, sample_rows


def test_rows_keep_seeds_and_robots_apart() -> None:
    t, k, e, n = 2, 3, 4, 5
    codes = np.stack(np.meshgrid(*map(np.arange, (t, k, e, n)), indexing="ij"), -1)
    shared = sample_rows(torch.from_numpy(codes), "shared")
    separate = sample_rows(torch.from_numpy(codes), "separate")
    assert shared.shape == (k, t * e * n, 4)
    assert separate.shape == (k * n, t * e, 4)
    for row in range(k):
        assert (shared[row, :, 1] == row).all()
    for row in range(k * n):
        assert (separate[row, :, 1] == row // n).all()
        assert (separate[row, :, 3] == row % n).all()


def test_pick_takes_each_rows_own_samples() -> None:
    values = torch.arange(24.0).view(2, 4, 3)
    rows = torch.tensor([[3, 0], [1, 1]])
    np.testing.assert_array_equal(pick(values, rows)[0], values[0, [3, 0]])
    np.testing.assert_array_equal(pick(values, rows)[1], values[1, [1, 1]])
