"""A study's file: what it may say, and that names in it are its own."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from docs.site.ablations import ABLATIONS
from swarmdata.errors import SpecError
from swarmdata.evaluation.study.plan import Baseline, Study
from swarmdata.registry.recipes import is_dataset
from tests.evaluation.study.conftest import Make

SHIPPED = Path(__file__).parents[3] / "cards" / "studies"


@pytest.mark.parametrize("name", ["regimes", "robustness", "information", "smoke"])
def test_shipped_studies_are_of_shipped_datasets(name: str) -> None:
    study = Study.from_file(SHIPPED / f"{name}.yaml")
    assert study.name == name
    assert all(map(is_dataset, study.datasets))
    assert len(study.seeds) >= (2 if name == "smoke" else 5)


@pytest.mark.parametrize(
    "file", sorted([*SHIPPED.glob("*.yaml"), *SHIPPED.glob("*/study.yaml")]),
    ids=lambda file: f"{file.parent.name}-{file.stem}",
)  # fmt: skip
def test_every_row_without_its_ingredient_stands_in_a_pair(file: Path) -> None:
    """Of the same length, with the settings that the registry takes the ingredient away by."""
    study = Study.from_file(file)
    pairs = study.differences["ingredient"].pairs if "ingredient" in study.differences else ()
    without = {label for label in study.algorithms if label.endswith("-without")}
    assert without <= {other for _, other in pairs}
    for one, other in pairs:
        row, bare = study.algorithms[one], study.algorithms[other]
        ablation = ABLATIONS[row.algorithm]
        assert ablation is not None
        assert bare.algorithm == (ablation.algorithm or row.algorithm)
        assert bare.settings == {**row.settings, **ablation.settings}, (one, other)
        assert bare.updates == row.updates


def test_doubling_is_twice_the_updates(make_study: Make) -> None:
    rows = {k: {"algorithm": "bc", "updates": n} for k, n in (("a", 7), ("b", 14))}
    study = make_study(algorithms=rows, **compared(["b", "a"], doubling=True))
    assert study.differences["x"].doubling
    with pytest.raises(SpecError, match="'a' is not 'b' with twice the updates"):
        make_study(algorithms=rows, **compared(["a", "b"], doubling=True))


@given(
    st.lists(st.integers(0, 99), min_size=1, unique=True),
    st.floats(0.01, 10),
    st.dictionaries(
        st.sampled_from(["alpha", "hidden"]),
        st.one_of(st.floats(0, 9), st.lists(st.integers(1, 9))),
    ),
)
def test_a_study_survives_its_own_yaml(
    seeds: list[int], budget: float, settings: dict[str, Any]
) -> None:
    algorithms = {"x": {"algorithm": "bc", "family": "f", "settings": settings}}
    content = {"name": "s", "datasets": ["d"], "algorithms": algorithms}
    study = Study.parse({**content, "seeds": seeds, "budget": budget})
    assert Study.from_text(study.to_yaml()) == study


SEEN = {"datasets": [], "algorithms": ["bc"], "views": {"recorded": {}}}
MIXED = {"mixtures": {"m": {"a": 3, "b": 1}}, "datasets": ["m"]}


def compared(*pairs: list[str], **plan: Any) -> dict[str, Any]:
    return {"differences": {"x": {"title": "x", "pairs": [*pairs], **plan}}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seeds": [1, 1]}, "repeat, expected different"),
        ({"algorithms": {"bc": {"seeds": [1, 1]}}}, "algorithms.bc.seeds.*repeat, expected"),
        ({"seed": [1]}, "unknown key. Did you mean 'seeds'"),
        ({"online": {"bc": {"run": "runs/x"}}}, "labels of both offline and online"),
        ({"sizes": {"datasets": ["x"], "algorithms": ["bc"]}}, "sizes.datasets has 'x'"),
        ({"sizes": {"datasets": [], "algorithms": ["x"]}}, "sizes.algorithms has 'x'"),
        ({"curves": {"datasets": ["x"]}}, "curves.datasets has 'x'"),
        ({"information": {**SEEN, "online": ["x"]}}, "information.online has 'x', which the study"),
        (
            {"information": {**SEEN, "online": ["x"]}, "online": {"x": {"run": "runs/x"}}},
            "information.online has x, a finished run",
        ),
        (
            {"information": {**SEEN, "views": {"near": {"observation": "near.yaml"}}}},
            r"information\.views\.near\.observation: got 'near.yaml', expected the name",
        ),
        ({"information": {**SEEN, "transfer": ["other"]}}, r"information\.transfer has 'other'"),
        (
            {"tasks": {"datasets": [], "algorithms": ["sets"], "tasks": ["coop_nav-n8"]}},
            r"tasks\.algorithms has 'sets'",
        ),
        (
            {"tasks": {"datasets": [], "algorithms": [], "tasks": ["easy", "mine/easy.yaml"]}},
            "several tasks are called easy",
        ),
        ({"online": {"x": {"run": "r", "start": "s"}}}, "either `run`, or"),
        ({"core": ["x"]}, "core.datasets has 'x'"),
        ({"datasets": ["a", "b"], "core": ["a"]}, "core needs at least two datasets.*got 1 and 2"),
        (
            {
                "datasets": ["a", "b"],
                "core": ["a", "b"],
                "algorithms": {"bc": {}, "iql": {"datasets": ["a"]}},
            },
            "core needs at least two datasets.*got 2 and 1",
        ),
        ({"mixtures": {"m": {"a": 3, "b": 1}}}, "mixtures has 'm', which the study lacks"),
        ({"mixtures": {"m": {"a": 3}}, "datasets": ["m"]}, "mixtures.m"),
        ({"mixtures": {"m": {"a": 3, "b": 0}}, "datasets": ["m"]}, "mixtures.m.b"),
        ({**MIXED, "sizes": {"datasets": ["m"], "algorithms": ["bc"]}}, "has the mixture m"),
        ({**MIXED, "algorithms": {"bc": {"rewards": "safe"}}}, "bc has rewards and learns from"),
        (
            {"losses": {"q": {"column": "q", "label": "q", "datasets": [], "algorithms": ["x"]}}},
            "losses.q.algorithms has 'x', which the study lacks: bc, other",
        ),
        (
            {"sweeps": {"s": {"dataset": "x", "vary": "communication", "axis": "drop=0..1"}}},
            "sweeps.s.datasets has 'x'",
        ),
        ({"sides": {"pursuers": "scripted"}, "curves": {}}, "sides cannot be combined with curves"),
        (compared(["bc", "y"]), "differences.x has 'y'"),
        (compared(["bc", "bc"]), "compares 'bc' with itself"),
        (compared(), "differences.x.pairs"),
        (compared(["other", "bc"], doubling=True), "'other' is not 'bc' with twice the updates"),
        ({"algorithms": {"a/b": {"algorithm": "bc", "family": "f"}}}, "algorithms"),
        ({"algorithms": ["bc", "bc"]}, "algorithms are named twice: bc"),
        ({"algorithms": []}, "algorithms"),
        ({"seeds": 0}, "seeds: 0 seeds, expected from 1 to 1000"),
        ({"budget": 2, "settings": {"n_updates": 9}}, "got budget and the setting n_updates"),
        (
            {"algorithms": {"bc": {"updates": 9, "settings": {"n_updates": 9}}}},
            r"algorithms\.bc: got updates and the setting n_updates",
        ),
        (
            {
                "online": {
                    "x": {
                        "algorithm": "mappo",
                        "task": "coop_nav",
                        "frames": 9,
                        "settings": {"n_steps": 9},
                    }
                }
            },
            r"online\.x: got frames and the setting n_steps",
        ),
    ],
)
def test_what_does_not_fit_is_refused(
    make_study: Make, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(SpecError, match=message):
        make_study(**changes)


@pytest.mark.parametrize(
    "fields",
    [{}, {"algorithm": "mappo"}, {"run": "x", "algorithm": "a", "task": "t"},
     {"run": "x", "frames": 3}],
)  # fmt: skip
def test_a_baseline_is_a_run_or_a_training(fields: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match="either `run`, or `algorithm` and `task`"):
        Baseline.parse(fields)


def test_families_keep_the_order_of_the_file(make_study: Make) -> None:
    named = {f"a{k}": {"algorithm": "bc", "family": family} for k, family in enumerate("bab")}
    assert make_study(algorithms=named).families == ("b", "a")


def test_algorithms_may_be_a_list_or_rows_without_a_name_and_seeds_a_number(
    make_study: Make,
) -> None:
    short = make_study(algorithms=["bc", "iql"], seeds=2)
    assert short.seeds == (0, 1)
    rows = {label: (row.algorithm, row.family) for label, row in short.algorithms.items()}
    assert rows == {"bc": ("bc", "bc"), "iql": ("iql", "iql")}
    assert Study.from_text(short.to_yaml()) == short
    named = {"bc": {"updates": 100}, "bc-long": {"algorithm": "bc", "family": "imitation"}}
    own, long = make_study(algorithms=named).algorithms.values()
    assert (own.algorithm, own.updates, long.family) == ("bc", 100, "imitation")


@pytest.mark.parametrize(("of_study", "asked", "expected"), [
    (40, None, 40), (1000, None, 200), (40, 60, 60), (1000, 500, 500),
])  # fmt: skip
def test_other_conditions_have_the_episodes_of_the_study(
    make_study: Make, of_study: int, asked: int | None, expected: int
) -> None:
    assert make_study(episodes=of_study).shifted_episodes(asked) == expected
