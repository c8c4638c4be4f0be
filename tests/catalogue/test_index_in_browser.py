"""The index page in a real Chromium, from `file://`: facets, table, address, sizes on a phone."""

import pytest

from tests.support.browser import Visit
from tests.support.tiny import TINY


def test_the_index_is_filtered_sorted_and_restored_from_its_address(visit: Visit) -> None:
    visit.open("index.html#view=cards")
    n_all = visit.run("document.querySelectorAll('#table tbody tr').length")
    visit.page.check("input[name=replays]")
    assert len(visit.texts(".card")) == 7 < n_all
    assert visit.texts("#shown") == [f"7 of {n_all} datasets"]

    visit.page.select_option("select[name=task]", "transport")
    assert visit.texts(".card h2") == ["transport-small-v0"]

    visit.page.click("button[type=reset]")
    visit.page.fill("input[name=search]", "coop_nav simulated")
    visit.page.select_option("select[name=sort]", "success")
    shares = [float(each) for each in visit.run("[...cards.children].map(c=>c.dataset.success)")]
    assert len(shares) > 3
    assert shares == sorted(shares, reverse=True)

    names = visit.texts(".card h2")
    address = visit.page.url
    visit.page.goto("about:blank")
    visit.page.goto(address)
    visit.page.wait_for_selector("body[data-ready=yes]")
    assert visit.texts(".card h2") == names


@pytest.mark.slow
def test_the_table_has_what_the_cards_have(visit: Visit) -> None:
    visit.open("index.html#task=transport&view=table")
    rows = visit.page.locator("#table tbody tr:visible")
    names = {text.split()[0] for text in rows.all_inner_texts()}
    assert not visit.page.is_visible(".card")
    assert len(names) > 2
    visit.page.click("#table thead button:has-text('score')")
    scores = visit.run(
        "[...document.querySelectorAll('#table tbody tr')].filter((row) => !row.hidden)"
        ".map((row) => Number(row.cells[6].dataset.value))"
    )
    assert scores == sorted(scores, reverse=True)
    visit.page.select_option("select[name=view]", "cards")
    assert set(visit.texts(".card h2")) == names


@pytest.mark.slow
def test_facets_are_what_the_datasets_are(visit: Visit) -> None:
    visit.open("index.html")
    for name, values in {
        "need": {"large": "transport-medium-v1", "unknown": "painting_v1-mine-v0"},
        "kind": {"other environment": "painting_v1-mine-v0"},
        "messages": {"yes": "coop_nav-peer-v0"},
        "costs": {"no": "painting_v1-mine-v0", "yes": "transport-medium-v1"},
    }.items():
        for value, expected in values.items():
            visit.open(f"index.html#{name}={value.replace(' ', '+')}")
            assert expected in visit.texts(".card h2"), (name, value)
            visit.open(f"index.html#{name}={value.replace(' ', '+')}&search={expected}")
            assert expected in visit.texts(".card h2")


@pytest.mark.slow
def test_filters_that_leave_nothing_say_how_to_widen(visit: Visit) -> None:
    visit.open("index.html#task=transport&team=4&kind=other+environment&search=medium-expert")
    assert visit.texts(".card") == []
    assert visit.texts("#shown")[0].startswith("0 of ")
    assert [text.split(" (")[0] for text in visit.texts("#widen button")] == [
        "Any source",
        "Clear all filters",
    ]
    visit.page.click("#widen button >> nth=0")
    assert visit.texts(".card h2") == ["transport-medium-expert-v1"]
    assert not visit.page.is_visible("#widen")
    visit.page.go_back()
    visit.wait("!document.getElementById('widen').hidden")
    visit.page.click("#widen button:has-text('Clear all')")
    visit.wait("document.querySelectorAll('.card').length > 3")


@pytest.mark.slow
def test_a_link_to_a_place_in_the_page_keeps_what_is_chosen(visit: Visit) -> None:
    visit.open("index.html#task=transport")
    names = visit.texts(".card h2")
    visit.page.focus(".skip")
    visit.page.keyboard.press("Enter")
    visit.wait("location.hash === '#content'")
    assert visit.texts(".card h2") == names
    visit.open(f"datasets/{TINY.id}.html#episode=3&t=1")
    visit.page.reload()
    visit.page.wait_for_selector("body[data-ready=yes]")
    visit.page.focus(".skip")
    visit.page.keyboard.press("Enter")
    visit.wait("location.hash === '#content'")
    assert visit.run("swarmdata.views[0].replay.position") == 3


@pytest.mark.slow
def test_controls_on_a_phone_are_large_enough_for_a_finger(visit: Visit) -> None:
    visit.page.set_viewport_size({"width": 390, "height": 844})
    for path in ("index.html", f"datasets/{TINY.id}.html", "results.html"):
        visit.open(path)
        small = visit.run(
            "[...document.querySelectorAll('button, select, summary, nav a, .sizes a, label.check,"
            " input:not([type=checkbox])')].filter((each) => each.offsetParent &&"
            " each.getBoundingClientRect().height < 40).map((each) => each.outerHTML)"
        )
        assert small == [], path
        assert visit.run("document.documentElement.scrollWidth") <= 390, path
