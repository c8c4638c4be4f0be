"""The numbers of docs/tiers.md are those of the measured references and the published datasets."""

from pathlib import Path

import numpy as np
import pytest

from swarmdata.registry.published import published, references

TEXT = " ".join((Path(__file__).parents[2] / "docs/tiers.md").read_text("utf-8").split())
OWN = [  # presets, or sides, for which policies were selected
    name
    for name, known in references().items()
    if "medium" in known.policies
    and (not name.endswith("-strict") or name.startswith(("coop_nav-c", "coop_nav-sw")))
]


def mean(name: str, policy: str, metric: str = "success") -> float:
    found = references()[name].policies[policy][metric]
    assert found is not None
    return found.value


def singles(name: str, tier: str) -> list[str]:
    return [each for each in references()[name].policies if each.startswith(f"{tier}-")]


def test_the_ranges_of_single_policies() -> None:
    mediums = [100 * mean(name, each) for name in OWN for each in singles(name, "medium")]
    assert f"solve {min(mediums):.0f} to {max(mediums):.0f} % (`medium`)" in TEXT
    shares = []
    for name in OWN:
        if name != "tag-evader":  # a scripted evader has a lower return than an idle one
            floor = max(mean(name, each, "return") for each in ("idle", "random"))
            top = mean(name, "scripted", "return") - floor
            returns = [mean(name, each, "return") for each in singles(name, "expert")]
            shares += [(each - floor) / top for each in returns]
    assert f"at least {100 * min(shares):.0f} % of that return (`expert`)" in TEXT
    assert {len(singles(name, "expert")) for name in OWN} == {4}
    assert {len(singles(name, "medium")) for name in OWN} == {4, 5, 6}


def test_what_noise_costs_mediums_of_strict_presets() -> None:
    said = []
    for preset in ("coop_nav-corridor-strict", "coop_nav-swap-strict"):
        recorded = published()[f"{preset}-medium-v1"].success
        said.append(f"{100 * recorded:.1f} % {{}}instead of {100 * mean(preset, 'medium'):.1f} %")
    assert said[0].format("of the episodes ") in TEXT
    assert said[1].format("") in TEXT


@pytest.mark.parametrize(
    ("preset", "sentence"),
    [
        ("coop_nav", "{clean:.0f} % of their episodes are contact-free, against {script:.0f} %"),
        ("warehouse", "{clean:.0f} % of their episodes are clean, against"),
        ("intersection", "{clean:.0f} % of their episodes are clean, against {script:.1f} %"),
        ("search", "solve {solved:.1f} % of the reserved episodes, {clean:.1f} % cleanly"),
    ],
)
def test_how_clean_experts_are(preset: str, sentence: str) -> None:
    values = {
        "clean": mean(preset, "expert", "clean_success"),
        "solved": mean(preset, "expert"),
        "script": mean(preset, "scripted", "clean_success"),
    }
    rounded = {name: float(np.round(100 * value, 1)) for name, value in values.items()}
    assert sentence.format(**rounded) in TEXT
