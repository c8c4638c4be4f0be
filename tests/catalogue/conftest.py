"""One catalogue for all tests: every task, a lidar and a lossy radio, a recording with images."""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from swarmdata.cards.card import write_card
from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue
from swarmdata.catalogue.result_sources import ResultSource, own_sources
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.hub.catalog.listing import DatasetInfo, list_datasets
from swarmdata.registry.presets import preset
from swarmdata.runtime.batches import Failures
from swarmdata.specs.model_choice import with_models
from tests.support.browser import CHROMIUM, TIMEOUT, Visit
from tests.support.image_world import record_images
from tests.support.tiny import TINY, make_tiny

STUDY = Path(__file__).parents[2] / "cards" / "studies" / "goals"
FEW = re.compile("(coop_nav|transport)-(random|scripted|medium|expert)-")
TASKS = ("formation", "transport", "warehouse")


def few_published() -> list[DatasetInfo]:
    """The published datasets that catalogues of tests show."""
    return [info for info in list_datasets() if FEW.match(info.id)]


@cache
def one_study() -> Sequence[ResultSource]:
    """The committed study that catalogues of tests show."""
    return own_sources([STUDY], Failures(1))


@contextmanager
def little_published() -> Iterator[None]:
    """Of what is published, one study and a few datasets are shown.

    Reading all studies and cards takes most of the time of a catalogue; `test_result_sources.py`
    and `pages/test_card_html.py` read all, and a slow test makes a catalogue of all datasets.
    """
    sources = one_study()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swarmdata.catalogue.build_catalogue.committed_sources", lambda *_: sources)
        patch.setattr("swarmdata.catalogue.entries.list_datasets", few_published)
        yield


@pytest.fixture(scope="session")
def shown(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> dict[str, Path]:
    """Folders of the datasets in the catalogue, by id."""
    root = tmp_path_factory.mktemp("shown")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARMDATA_CACHE", str(root / "cache"))
        sensed = with_models(TINY.spec, "lidar", "lossy-30+delayed-2")
        found = {
            "tiny": make_tiny(root / TINY.id),
            "peer": make_tiny(root / "coop_nav-peer-v0", id="coop_nav-peer-v0", spec=sensed),
        }
        write_card(found["tiny"])
        for name in TASKS:
            spec = preset(name).with_updates(horizon=30)
            found[name] = record(root / f"{name}-small-v0", spec, ("random",))
        found["images"] = record_images(root / "images").path
        more = record_images(root / "more", 4, id="painting_v1-more-v0")
        found["more"] = more.path
    return found


@pytest.fixture(scope="session")
def measured(shown: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of results of a run with two training seeds, which is beside it."""
    pytest.importorskip("torch", reason="training needs the torch extra")
    from swarmdata.evaluation.runs.train import train

    root = tmp_path_factory.mktemp("measured")
    changes = {"n_updates": "5", "hidden": "8", "batch_size": "16"}
    folder = str(shown["tiny"])
    train("bc", folder, root / "bc", n_seeds=2, changes=changes, progress=False)
    evaluate_target(find_target(str(root / "bc")), 5, root / "results", progress=False)
    return root / "results"


@pytest.fixture(scope="session")
def site(shown: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a catalogue of these datasets."""
    out = tmp_path_factory.mktemp("catalogue") / "site"
    with little_published():
        build_catalogue([str(folder) for folder in shown.values()], out, CatalogueChoices())
    return out


@pytest.fixture(scope="session")
def results_site(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a catalogue with results whose run is at hand, and of committed studies."""
    with pytest.MonkeyPatch.context() as patch, little_published():
        patch.setenv("SWARMDATA_CACHE", str(tmp_path_factory.mktemp("empty")))
        out = tmp_path_factory.mktemp("results_catalogue") / "site"
        build_catalogue([], out, CatalogueChoices(results=(measured,)))
    return out


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One browser for all tests; in containers Chromium cannot make its own sandbox.

    It needs the package playwright and Debian's chromium; no browser is downloaded.
    """
    playwright = pytest.importorskip(
        "playwright.sync_api",
        reason="drives the browser; the dependency group 'test' has playwright",
    )
    if CHROMIUM is None:
        pytest.skip("needs a Chromium; on Debian: apt-get install chromium")
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(
            executable_path=CHROMIUM,
            args=[*sandbox, "--disable-dev-shm-usage", "--disable-gpu"],
            timeout=TIMEOUT,
        )
        yield found
        found.close()


@pytest.fixture
def visit(browser: Any, site: Path) -> Iterator[Visit]:
    """A fresh page; afterwards nothing may have gone wrong, and nothing left the folder."""
    with visited(browser, site) as found:
        yield found


@pytest.fixture
def visit_results(browser: Any, results_site: Path) -> Iterator[Visit]:
    """The same of the catalogue with results."""
    with visited(browser, results_site) as found:
        yield found


@contextmanager
def visited(browser: Any, site: Path) -> Iterator[Visit]:
    """Opens a page, and checks at the end what it did."""
    context = browser.new_context(viewport={"width": 1300, "height": 950})
    page = context.new_page()
    page.set_default_timeout(TIMEOUT)
    found = Visit(page, site)
    page.on("console", found.hear)
    page.on("pageerror", lambda error: found.complaints.append(str(error)))
    page.on("request", lambda request: found.requests.append(request.url))
    yield found
    context.close()
    assert found.complaints == []
    outside = [url for url in found.requests if not url.startswith((site.as_uri(), "data:"))]
    assert outside == []
