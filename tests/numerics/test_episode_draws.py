"""Draws of episodes: within their ranges, functions of the seed, the same in compiled code."""

import numpy as np

from swarmdata.numerics.episode_draws import draw, draw_share, drawn_values
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.randomization import RANDOM_FIELDS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Seeds

SEEDS = np.arange(4000, dtype=np.uint64)
SPEC = TaskSpec.parse(
    {
        "team": [{"count": 3, "robot": {"dynamics": "unicycle"}}],
        "communication": communication_model("perfect").model_dump(),
        "randomization": {
            "mass": [0.5, 2.5],
            "command_delay": [1, 3],
            "noise": [0.0, 0.2],
            "drop_probability": [0.25, 0.75],
        },
    }
)

GOLDEN = [0.6452098992148627, 1.0751010164382808, 0.8871327494709353]
"""Masses of the first episode."""


@kernel
def _shares(seeds: Seeds, field: int, out: Double) -> None:
    for b in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[b, i] = draw_share(seeds[b], field, i)


def test_values_are_uniform_in_their_ranges_and_robots_differ() -> None:
    found = drawn_values(SPEC, SEEDS)
    assert list(found) == ["mass", "command_delay", "noise", "drop_probability"]
    for name, (low, high) in SPEC.randomization.ranges.items():
        values = found[name]
        assert values.shape == (len(SEEDS), 1 if name == "drop_probability" else 3)
        assert low <= values.min()
        assert values.max() <= high
        np.testing.assert_allclose(values.mean(0), (low + high) / 2, atol=0.03 * (high - low))
    assert abs(np.corrcoef(found["mass"].T) - np.eye(3)).max() < 0.06
    assert abs(np.corrcoef(found["mass"][:, 0], found["noise"][:, 0])[0, 1]) < 0.06
    delays, counts = np.unique(found["command_delay"], return_counts=True)
    assert delays.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(counts / counts.sum(), 1 / 3, atol=0.02)


def test_an_episode_has_one_payload() -> None:
    ranges = {"payload_mass": (2.0, 8.0), "payload_friction": (1.0, 4.0)}
    spec = TaskSpec.parse({"rules": {"task": "transport"}, "randomization": ranges})
    found = drawn_values(spec, SEEDS)
    assert {name: values.shape for name, values in found.items()} == dict.fromkeys(
        ranges, (len(SEEDS), 1)
    )
    for name, (low, high) in ranges.items():
        np.testing.assert_allclose(found[name].mean(), (low + high) / 2, rtol=0.03)
    assert (
        abs(np.corrcoef(found["payload_mass"][:, 0], found["payload_friction"][:, 0])[0, 1]) < 0.06
    )


def test_a_draw_depends_on_its_seed_alone() -> None:
    """A golden value: seeds of recorded episodes must give the same bodies for ever."""
    whole = draw(SPEC, "mass", SEEDS)
    np.testing.assert_array_equal(draw(SPEC, "mass", SEEDS[7:9]), whole[7:9])
    other = SPEC.with_updates(randomization={"mass": (0.5, 2.5)})
    np.testing.assert_array_equal(draw(other, "mass", SEEDS), whole)
    assert whole[0].tolist() == GOLDEN


def test_compiled_code_draws_the_same() -> None:
    found = np.empty((len(SEEDS), 3))
    _shares(SEEDS, RANDOM_FIELDS.index("noise"), found)
    np.testing.assert_array_equal(0.0 + 0.2 * found, draw(SPEC, "noise", SEEDS))


def test_nothing_is_drawn_of_a_spec_without_ranges() -> None:
    assert drawn_values(TaskSpec(), SEEDS) == {}
