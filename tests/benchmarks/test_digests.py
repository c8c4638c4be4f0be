"""Variants of a build, and the table of digests."""

import pytest

from swarmdata.registry.published import published
from swarmdata.registry.recipes import shipped_recipes
from tests.benchmarks import bench_digests
from tests.benchmarks.bench_digests import Built, build, compare_published, main
from tests.benchmarks.variants import (
    THREADS,
    Probe,
    Variant,
    variants,
)

MINI = "coop_nav-random-mini-v1"
A = "a" * 64


def named(name: str) -> Variant:
    return next(variant for variant in variants() if variant.name == name)


def built(digest: str) -> Built:
    return Built(digest, "" if digest else "it broke", 1.0)


def test_each_variant_differs_from_the_default_in_what_it_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Nehalem")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    default = named("default").variables()
    assert "OPENBLAS_CORETYPE" not in default
    assert {default[name] for name in THREADS} == {"1"}
    haswell = named("Haswell").variables()
    assert haswell == {**default, "OPENBLAS_CORETYPE": "Haswell"}
    two = named("2 threads").variables()
    assert {name for name in two if two[name] != default[name]} == set(THREADS)
    assert named("2 workers").variables() == default


@pytest.mark.parametrize(
    ("name", "found", "reason"),
    [
        ("Haswell", Probe("Haswell", 1, ()), ""),
        ("Prescott", Probe("Katmai", 1, ()), ""),
        ("SkylakeX", Probe("Haswell", 1, ()), "OpenBLAS runs Haswell instead"),
        ("Haswell", Probe(None, 1, ()), "not OpenBLAS"),
        ("2 threads", Probe("Haswell", 2, ()), ""),
        ("2 threads", Probe("Haswell", 1, ()), "OpenBLAS runs 1 threads"),
        ("3 kills", Probe(None, 1, ()), ""),
    ],
)
def test_a_setting_that_does_nothing_is_no_variant(name: str, found: Probe, reason: str) -> None:
    said = named(name).obstacle(found)
    assert reason in said
    assert bool(said) == bool(reason)


@pytest.mark.slow
def test_a_build_gives_its_digest_or_says_why_not() -> None:
    good = build(MINI, named("default"), n_steps=400)
    assert len(good.digest) == 64
    assert good.message == ""
    assert good.seconds > 0
    bad = build("coop_nav-nothing-mini", named("default"), n_steps=400)
    assert bad.digest == ""
    assert "coop_nav-nothing-mini" in bad.message


def test_published_digests_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = next(iter(published().values()))
    fresh = entry.model_copy(update={"recipe_hash": shipped_recipes()[MINI].hash()})
    monkeypatch.setattr(bench_digests, "published", lambda: {MINI: fresh})
    assert compare_published(MINI, fresh.digest) == "same"
    assert compare_published(MINI, "0" * 64) == "DIFFERENT"
    monkeypatch.setattr(
        bench_digests, "published", lambda: {MINI: fresh.model_copy(update={"recipe_hash": A})}
    )
    assert compare_published(MINI, fresh.digest) == "STALE"
    monkeypatch.setattr(bench_digests, "published", dict)
    assert compare_published(MINI, A) == "none"


@pytest.mark.parametrize(("against", "clean"), [("same", True), ("DIFFERENT", False)])
@pytest.mark.parametrize("digest", [A, "b" * 64], ids=["same", "other"])
def test_the_command_ends_with_1_if_anything_differs(
    against: str, clean: bool, digest: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def fake(dataset: str, variant: Variant, **options: object) -> Built:
        return built(A if variant.name == "default" else digest)

    monkeypatch.setattr(bench_digests, "build", fake)
    monkeypatch.setattr(bench_digests, "compare_published", lambda dataset, digest: against)
    code = main(["--only", "coop_nav-random-mini", "--variants", "2 workers"])
    assert code == (0 if clean and digest == A else 1)
    out = capsys.readouterr().out
    assert "| dataset | published | default | 2 workers |" in out
    assert MINI in out
