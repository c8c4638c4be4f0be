"""Lag, delay, gains and noise that our own simulator had are found again."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.interop.logs.logged_drives import AS_COMMANDED, Response
from swarmdata.interop.logs.response_fits import error_sources, fit_response
from tests.interop.logs.driven_robots import DT, drives_of, played, random_commands, simulated
from tests.support.pairs import once_each, slow


@pytest.mark.parametrize(("case", "noise"), once_each(range(8), (0.0, 0.003)))
def test_the_simulators_response_is_recovered(case: int, noise: float) -> None:
    rng = np.random.default_rng(case)
    true = Response(
        speed_gain=rng.uniform(0.6, 1.3),
        turn_gain=rng.uniform(0.6, 1.3),
        lag=rng.choice([0.0, rng.uniform(0.0, 0.5)]),
        delay=int(rng.integers(0, 6)),
    )
    commands = random_commands(600, case)
    poses = played(simulated([true, true]), commands)
    poses = poses + rng.normal(0, noise, poses.shape)
    fit = fit_response(drives_of(poses, commands))
    assert fit is not None
    assert not fit.lacks
    assert_allclose(fit.response.speed_gain, true.speed_gain, rtol=0.01)
    assert_allclose(fit.response.turn_gain, true.turn_gain, rtol=0.01)
    late = fit.response.delay * DT + fit.response.lag
    assert_allclose(late, true.delay * DT + true.lag, atol=0.03)
    if noise == 0.0:  # which would hide what is a delay and what is a lag
        assert fit.response.delay == true.delay
        assert_allclose(fit.response.lag, true.lag, atol=0.015)  # shorter ones have no effect


def test_predictions_are_those_of_the_simulator() -> None:
    true = Response(speed_gain=0.9, turn_gain=1.1, lag=0.15, delay=2)
    commands = random_commands(300, 1)
    drives = drives_of(played(simulated([true, true]), commands), commands)
    distances, angles, episodes = drives.errors_of([true, true], 20)
    assert len(distances) == 2 * 14  # each 2 s, after the first one
    assert set(episodes) == {0}
    assert distances.max() < 1e-3
    assert angles.max() < 1e-3
    worse, _, _ = drives.errors_of([AS_COMMANDED, AS_COMMANDED], 20)
    assert worse.mean() > 0.05


@pytest.mark.parametrize("noise", [0.02, *slow(0.004)])
def test_the_noise_of_poses_is_recovered(noise: float) -> None:
    true = Response(speed_gain=1.0, turn_gain=0.9, lag=0.1)
    commands = random_commands(1500, 2)
    poses = played(simulated([true, true]), commands)
    noisy = poses + np.random.default_rng(0).normal(0, noise, poses.shape)
    found = error_sources(drives_of(noisy, commands), [true, true])
    assert_allclose([found.position, found.heading], noise, rtol=0.15)
    assert max(found.speed_bias, found.turn_bias) < 0.2 * noise


@pytest.mark.slow
def test_errors_of_actuation_are_told_from_noise_of_poses() -> None:
    """Every step of a robot goes wrong by a random amount, and poses are exact."""
    rng, deviation = np.random.default_rng(3), 0.002
    commands = random_commands(3000, 3)
    poses = played(simulated([AS_COMMANDED, AS_COMMANDED]), commands)
    poses[1:, :, :2] += np.cumsum(rng.normal(0, deviation, poses[1:, :, :2].shape), axis=0)
    found = error_sources(drives_of(poses, commands), [AS_COMMANDED, AS_COMMANDED])
    assert found.position < deviation
    assert_allclose(found.speed_walk, deviation / np.sqrt(DT), rtol=0.15)


def test_too_little_to_fit() -> None:
    commands = random_commands(40, 0)
    drives = drives_of(played(simulated([AS_COMMANDED, AS_COMMANDED]), commands), commands)
    drives.known[:, :, 30:] = False
    assert fit_response(drives) is None


def test_a_response_beyond_the_search_is_not_trusted() -> None:
    true = Response(speed_gain=1.0, turn_gain=1.0, lag=0.0, delay=14)
    commands = random_commands(600, 4)
    fit = fit_response(drives_of(played(simulated([true, true]), commands), commands))
    assert fit is not None
    assert fit.lacks
