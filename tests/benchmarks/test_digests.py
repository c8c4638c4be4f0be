"""Variants of a build, and the table of digests."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.registry.published import published
from swarmdata.registry.recipes import shipped_recipes
from tests.benchmarks import bench_digests
from tests.benchmarks.bench_digests import Built, build, compare_published, is_clean, main, row
from tests.benchmarks.variants import (
    CLEARED,
    THREADS,
    Probe,
    Variant,
    found_features,
    probe,
    variants,
)

MINI = "coop_nav-random-mini-v1"
A, B = "a" * 64, "b" * 64
DIGESTS = st.sampled_from([A, B, ""])


def named(name: str) -> Variant:
    return next(variant for variant in variants() if variant.name == name)


def built(digest: str) -> Built:
    return Built(digest, "" if digest else "it broke", 1.0)


def test_variants_cover_what_may_change_bits() -> None:
    names = [variant.name for variant in variants()]
    assert names[0] == "default"
    assert len(set(names)) == len(names)
    assert {"Prescott", "Sandybridge", "Haswell", "SkylakeX", "plain NumPy"} <= set(names)
    assert {"2 workers", "2 threads", "3 kills"} <= set(names)


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


@pytest.mark.skipif(not found_features(), reason="NumPy has no optional features here")
def test_numpy_without_its_features_says_so() -> None:
    variant = named("plain NumPy")
    assert variant.environment["NPY_DISABLE_CPU_FEATURES"].split() == list(found_features())
    assert "still uses X86_V3" in variant.obstacle(Probe(None, 1, ("X86_V3",)))
    assert variant.unavailable() == ""


def test_a_fresh_interpreter_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def obstacle(found: Probe) -> str:
        asked.append(found)
        return "why not"

    settings = {name: os.environ[name] for name in CLEARED if name in os.environ}  # as ours
    assert Variant("default", settings, obstacle=obstacle).unavailable() == "why not"
    assert asked == [probe()._replace(n_threads=1)]


def test_a_build_gives_its_digest_or_says_why_not() -> None:
    good = build(MINI, named("default"), n_steps=400)
    assert len(good.digest) == 64
    assert good.message == ""
    assert good.seconds > 0
    bad = build("coop_nav-nothing-mini", named("default"), n_steps=400)
    assert bad.digest == ""
    assert "coop_nav-nothing-mini" in bad.message


def test_a_build_that_is_killed_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A stand-in for the build: it writes down its starts, and ends only from the third on."""
    notes = tmp_path / "starts"
    script = (
        "import sys, time; notes = open(sys.argv[1], 'a+'); notes.write('x'); notes.flush();"
        "notes.seek(0); len(notes.read()) > 2 or time.sleep(60); print('digest ' + 'a' * 64)"
    )
    line = [sys.executable, "-c", script, str(notes)]
    monkeypatch.setattr(bench_digests, "command", lambda *_: line)
    twice = Variant("killed", n_kills=2)
    assert build(MINI, twice, typical=3.0).digest == A
    assert notes.read_text() == "xxx"


def test_a_build_that_ends_before_it_is_killed_proves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bench_digests, "command", lambda *_: [sys.executable, "-c", "pass"])
    made = build(MINI, Variant("killed", n_kills=1), typical=60.0)
    assert made.digest == ""
    assert "before it could be killed" in made.message


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


@given(default=DIGESTS, others=st.lists(st.none() | DIGESTS, max_size=4))
def test_a_row_is_clean_if_all_that_was_built_is_the_default(
    default: str, others: list[str | None]
) -> None:
    names = ["default", *(f"v{k}" for k in range(len(others)))]
    digests = dict(zip(names, (default, *others), strict=True))
    results = {name: built(digest) for name, digest in digests.items() if digest is not None}
    cells = row(MINI, "none", results, names)
    assert len(cells) == len(names) + 2
    assert is_clean(cells) == (default != "" and all(d in (None, default) for d in others))


@pytest.mark.parametrize(("against", "clean"), [("same", True), ("DIFFERENT", False)])
@pytest.mark.parametrize("digest", [A, B], ids=["same", "other"])
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


def test_what_cannot_be_had_is_left_out_with_a_reason(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = Variant("absent", obstacle=lambda probe: "no such processor")
    monkeypatch.setattr(bench_digests, "variants", lambda: (Variant("default"), absent))
    monkeypatch.setattr(bench_digests, "build", lambda *args, **options: built(A))
    assert main(["--only", MINI, "--steps", "400"]) == 0
    out = capsys.readouterr().out
    assert "absent is left out: no such processor." in out
    assert f"| {MINI} | — | {A[:12]} | — |" in out
