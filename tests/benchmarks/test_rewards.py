"""What is measured of rewards is what the words beside it say."""

import numpy as np
import pytest

from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from tests.benchmarks import bench_rewards as bench

SPEC = preset("coop_nav")
N_EPISODES = 6


def played(**weights: float) -> bench.Outcome:
    """Random actions in `coop_nav`, with some weights multiplied."""
    rewards = SPEC.rules.rewards.model_dump()
    changed = {name: factor * rewards[name] for name, factor in weights.items()}
    rules = SPEC.rules.model_dump() | {"rewards": rewards | changed}
    spec = SPEC.with_updates(rules=rules)
    return bench.play(make_env(spec, N_EPISODES), make_policy("random", spec), N_EPISODES)


@pytest.mark.parametrize(
    ("part", "names"),
    [
        (
            "contacts",
            ("robot_contact", "obstacle_contact", "robot_collision", "obstacle_collision"),
        ),
        ("proximity", ("proximity",)),
        ("own", ("progress", "time")),
    ],
)
def test_a_part_is_what_its_weights_multiply(part: str, names: tuple[str, ...]) -> None:
    once, thrice = played(), played(**dict.fromkeys(names, 3.0))
    assert (once[part] != 0).any()
    assert np.allclose(thrice["return"] - once["return"], 2 * once[part], atol=1e-4)


def test_parts_add_up_to_the_return() -> None:
    spec = preset("coop_nav-easy")
    found = bench.play(make_env(spec, 4), make_policy("scripted", spec), 4)
    assert found["success"].tolist() == [1.0] * 4
    assert found["success_reward"].tolist() == [spec.rules.rewards.success] * 4
    assert np.allclose(sum(found[part] for part in bench.PARTS), found["return"])


def outcomes() -> dict[str, bench.Outcome]:
    """Two teams: one is cleaner, the other has the higher return."""
    spread = np.linspace(-0.1, 0.1, 40)

    def team(clean: float, *parts: float) -> bench.Outcome:
        values = dict(zip(bench.PARTS, (np.full(40, part) for part in parts), strict=True))
        return values | {
            "return": sum(parts) + spread,
            "clean_success": clean + spread**2,
            "success": np.ones(40),
        }

    return {"slow": team(0.9, 1.0, 3.0, -0.1, -0.5), "fast": team(0.5, 2.0, 3.0, -0.3, -0.6)}


def test_contradictions_and_what_would_resolve_them() -> None:
    found = outcomes()
    (pair,) = bench.contradictions(found)
    assert (pair.cleaner, pair.other) == ("slow", "fast")
    assert pair.clean_success == pytest.approx(0.4)
    assert pair.returns == pytest.approx(-0.7)
    assert pair.without_speed == pytest.approx(0.3)
    assert pair.break_even("contacts") == pytest.approx(4.5)
    assert pair.break_even("proximity") == pytest.approx(8.0)
    assert [bench.rank(found, "slow", name) for name in bench.RANKED] == [2, 1, 1]


def test_no_factor_turns_what_does_not_differ() -> None:
    pair = bench.Contradiction("a", "b", 0.1, -0.5, (-0.5, 0.0, 0.0, 1.0))
    assert pair.break_even("contacts") is None
    assert bench.pair_row(pair)[-2:] == ("none", "1.50")


def test_small_differences_are_no_contradictions() -> None:
    found = outcomes()
    noise = np.where(np.arange(40) % 2, 30.0, -30.0)
    noisy = {**found["slow"], "return": found["slow"]["return"] + noise}
    assert list(bench.contradictions({**found, "slow": noisy})) == []
