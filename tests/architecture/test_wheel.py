"""The wheel holds the package, all of it, and nothing beside it."""

import pytest

from tests.support.package_sources import FOLDERS, ROOT, sources

pytest.importorskip("hatchling", reason="builds the wheel; the dependency group 'test' has it")

from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder


@pytest.fixture(scope="module")
def wheel_names() -> set[str]:
    """What `hatchling build` puts into a wheel; packing it would take most of the time."""
    return {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}


def test_only_the_package_is_at_the_top(wheel_names: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel_names}

    assert tops == {"swarmdata"}


def test_every_source_is_inside(wheel_names: set[str]) -> None:
    paths = [path.as_posix() for path in sources()]
    expected = {path if path.startswith("swarmdata/") else f"swarmdata/{path}" for path in paths}

    assert {path.split("/")[0] for path in paths} == set(FOLDERS)
    assert expected <= wheel_names


def test_data_files_of_the_package_are_inside(wheel_names: set[str]) -> None:
    patterns = (
        "online_algos/configs/*.yaml",
        "behavior_policies/checkpoints/*",
        "cards/*.json",
    )
    expected = {f"swarmdata/{p.relative_to(ROOT)}" for each in patterns for p in ROOT.glob(each)}
    assets = (ROOT / "swarmdata/catalogue/assets").iterdir()
    expected |= {str(path.relative_to(ROOT)) for path in assets}

    assert "swarmdata/online_algos/configs/coop_nav-expert.yaml" in expected
    assert "swarmdata/catalogue/assets/catalogue.css" in expected
    assert expected <= wheel_names


def test_studies_are_inside_without_their_episodes_and_pictures(wheel_names: set[str]) -> None:
    cards = {name for name in wheel_names if name.startswith("swarmdata/cards/")}

    assert "swarmdata/cards/studies/goals/estimates.csv" in cards
    assert "swarmdata/cards/published/coop_nav-expert-mini-v1.md" in cards
    assert not {name for name in cards if name.endswith((".png", ".gif", ".xz"))}


def test_the_source_archive_makes_the_same_wheel(wheel_names: set[str]) -> None:
    builder = SdistBuilder(str(ROOT))
    inside = {file.distribution_path for file in builder.recurse_included_files()}

    files = {name.removeprefix("swarmdata/") for name in wheel_names}
    assert {name for name in files if name.split("/")[0] in FOLDERS} <= inside


def test_no_compiled_file_is_inside(wheel_names: set[str]) -> None:
    assert "swarmdata/py.typed" in wheel_names
    assert not [name for name in wheel_names if name.endswith((".pyc", ".nbi", ".nbc"))]
