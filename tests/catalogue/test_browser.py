"""The pages in a real Chromium, from `file://`: filter, sort, replay, deep links, side by side."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import attempted_links
from swarmdata.perception.observer import features_of
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_task
from swarmdata.specs.state_layout import X, Y, robots_of
from tests.support.browser import Visit
from tests.support.tiny import TINY

pytestmark = pytest.mark.slow


def test_a_dataset_leads_to_its_other_size_and_tiers(visit: Visit) -> None:
    visit.open("datasets/coop_nav-medium-v1.html")
    tiers = visit.texts(".tiers a b")
    assert {"random", "medium", "expert", "scripted"} <= set(tiers)
    with visit.page.expect_navigation():
        visit.page.click("nav.sizes a:has-text('Mini')")
    assert visit.page.url.endswith("/coop_nav-medium-mini-v1.html")
    with visit.page.expect_navigation():
        visit.page.click(".tiers a:has-text('scripted')")
    assert visit.page.url.endswith("/coop_nav-scripted-mini-v1.html")


def test_replays_are_where_the_recording_was(visit: Visit, shown: dict[str, Path]) -> None:
    dataset = Dataset.open(shown["tiny"])
    for index in (0, len(dataset) - 1):
        visit.open(f"datasets/{TINY.id}.html#episode={index}&t=1.5")
        visit.page.reload()
        visit.page.wait_for_selector("body[data-ready=yes]")
        robots = robots_of(dataset[index].states, 4)

        found = visit.run(
            "Array.from({length: swarmdata.views[0].replay.rows}, (_, t) =>"
            " [0, 1, 2, 3].map((i) => swarmdata.views[0].replay.place(i, t)))"
        )

        np.testing.assert_allclose(found, robots[..., [X, Y]], atol=0.00051)
        assert visit.run("swarmdata.player.time") == 1.5
        returns = visit.run("swarmdata.views[0].replay.returns.at(-1)")
        assert returns == pytest.approx(dataset[index].team_return, abs=0.05)


def test_play_pause_step_scrub_and_the_keyboard(visit: Visit) -> None:
    visit.open(f"datasets/{TINY.id}.html#episode=1")
    page = visit.page
    page.select_option("select[name=speed]", "0.25")
    page.click(".play")
    visit.wait("swarmdata.player.time > 0.05")
    assert page.get_attribute(".play", "aria-label") == "Pause"
    page.click(".play")
    paused = visit.run("swarmdata.player.time")
    assert not visit.run("swarmdata.player.isPlaying")
    assert f"t={paused:.2f}".rstrip("0").rstrip(".") in page.url

    page.locator("h1").click()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert visit.run("swarmdata.player.time") == pytest.approx(0.2)
    page.keyboard.press("Shift+ArrowRight")
    assert visit.run("swarmdata.player.time") == pytest.approx(1.2)
    page.keyboard.press("ArrowLeft")
    assert visit.run("swarmdata.player.time") == pytest.approx(1.1)
    page.keyboard.press("End")
    assert visit.run("swarmdata.player.time") == visit.run("swarmdata.player.duration")
    page.keyboard.press("Space")
    visit.wait("swarmdata.player.isPlaying")
    page.keyboard.press("Space")
    assert not visit.run("swarmdata.player.isPlaying")

    page.fill("input[type=range]", "0.7")
    assert visit.run("swarmdata.player.time") == pytest.approx(0.7)
    assert "0.7 s of" in visit.texts(".clock")[0]


def test_the_table_is_filtered_sorted_and_opens_episodes(visit: Visit) -> None:
    visit.open(f"datasets/{TINY.id}.html")
    page = visit.page
    n_all = page.locator(".rows tbody tr").count()
    page.click("button[data-sort=return]")
    returns = [float(text) for text in visit.texts(".rows tbody td:nth-child(4)")]
    assert returns == sorted(returns)
    assert page.get_attribute("th[data-column=return]", "aria-sort") == "ascending"
    page.click("button[data-sort=return]")
    assert [float(text) for text in visit.texts(".rows tbody td:nth-child(4)")] == returns[::-1]

    middle = sorted(returns)[n_all // 2]
    page.fill("fieldset[data-name=return] input >> nth=0", str(middle - 0.01))
    kept = page.locator(".rows tbody tr").count()
    assert kept == sum(value >= middle for value in returns) < n_all
    assert visit.texts(".count") == [f"{kept} of {n_all} episodes"]

    page.click(".clear")
    page.select_option("select[name=policy]", "b")
    assert set(visit.texts(".rows tbody td:nth-child(2)")) == {"b"}
    page.click(".rows tbody tr >> nth=1")
    index = visit.texts(".rows tbody tr[aria-current] td:nth-child(1)")[0]
    visit.wait(f"location.hash.includes('episode={index}')")
    assert f"episode {index} " in visit.texts(".outcome")[0]
    visit.wait("document.activeElement === swarmdata.player.button")
    page.keyboard.press("Space")
    visit.wait("swarmdata.player.time > 0")
    page.click(".next")
    visit.wait(f"!location.hash.includes('episode={index}')")


def test_a_range_is_dragged_over_a_histogram(visit: Visit) -> None:
    visit.open(f"datasets/{TINY.id}.html")
    histogram = visit.page.locator("fieldset[data-name=return] svg")
    histogram.scroll_into_view_if_needed()
    box = histogram.bounding_box()
    middle = box["y"] + box["height"] / 2
    visit.page.mouse.move(box["x"] + 0.55 * box["width"], middle)
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + box["width"] - 1, middle)
    visit.page.mouse.up()

    values = visit.run("swarmdata.table.rows.map((row) => row.return)")
    kept = visit.run("swarmdata.table.kept.map((row) => row.return)")
    start = min(values) + 13 / 24 * (max(values) - min(values))
    assert sorted(kept) == sorted(value for value in values if value >= start - 1e-3)
    assert 0 < len(kept) < len(values)


def test_two_episodes_are_side_by_side_at_one_time(visit: Visit) -> None:
    visit.open(f"datasets/{TINY.id}.html#episode=2&t=1")
    page = visit.page
    page.click(".compare")
    page.wait_for_selector("figure >> nth=1")
    page.select_option("select[name=dataset]", "coop_nav-peer-v0")
    visit.wait("location.hash.includes('with=coop_nav-peer-v0')")
    assert visit.texts("#notice") == ["Both episodes have the same seed."]
    page.fill("input[name=other]", "5")
    page.press("input[name=other]", "Tab")
    visit.wait("location.hash.includes('other=5')")
    visit.run("swarmdata.player.seek(2)")
    assert visit.run("swarmdata.views.map((view) => view.step)") == [20, 20]

    address = page.url
    page.click(".compare")
    assert not page.is_visible("figure >> nth=1")
    page.goto("about:blank")
    page.goto(address)
    page.wait_for_selector("body[data-ready=yes]")
    assert page.is_visible("figure >> nth=1")
    assert visit.run("swarmdata.views.map((view) => view.replay.position)") == [2, 5]


def test_what_is_played_is_in_sight_of_the_play_button(visit: Visit) -> None:
    visit.page.set_viewport_size({"width": 1360, "height": 768})
    for name in (TINY.id, "formation-small-v0", "painting_v1-mine-v0"):
        visit.open(f"datasets/{name}.html")
        box = visit.page.locator(".play").bounding_box()
        assert box["y"] + box["height"] <= 768
        assert visit.run("scrollY") == 0
    visit.open("datasets/formation-small-v0.html")
    assert visit.page.locator(".stage canvas >> nth=0").bounding_box()["height"] > 300
    visit.page.click(".compare")
    visit.wait("document.querySelector('.play').getBoundingClientRect().bottom <= 768")


def test_back_leads_to_the_last_choice(visit: Visit) -> None:
    visit.open("index.html")
    n_all = visit.page.locator(".card").count()
    visit.page.select_option("select[name=task]", "transport")
    n_some = visit.page.locator(".card").count()
    visit.page.fill("input[name=search]", "small")
    visit.page.check("input[name=replays]")
    assert visit.page.locator(".card").count() < n_some < n_all
    visit.page.go_back()
    assert visit.page.input_value("input[name=search]") == "small"
    assert not visit.page.is_checked("input[name=replays]")
    visit.page.go_back()
    visit.wait(f"document.querySelectorAll('.card').length === {n_all}")
    visit.run("location.hash = '#task=transport'")
    visit.wait(f"document.querySelectorAll('.card').length === {n_some}")

    visit.open(f"datasets/{TINY.id}.html#episode=1")
    visit.page.click(".next")
    visit.wait("location.hash.startsWith('#episode=2')")
    visit.page.go_back()
    visit.wait("swarmdata.views[0].replay.position === 1")


def test_beams_end_where_the_lidar_measures(visit: Visit, shown: dict[str, Path]) -> None:
    dataset = Dataset.open(shown["peer"])
    episode, spec = dataset[1], dataset.task
    scans = scan_of(features_of(make_task(spec)), episode.observations)
    assert scans is not None
    visit.open("datasets/coop_nav-peer-v0.html#episode=1")
    visit.page.check("[data-option=sensors]")

    for step in (0, 7, len(episode)):
        found = visit.run(
            f"[0, 1, 2, 3].map((i) => swarmdata.rays.cast(swarmdata.views[0].replay, i, {step})"
            ".map((beam) => beam.distance))"
        )
        # rounded positions move a beam at most a little, except where it passes an edge
        errors = np.abs(np.array(found) - 2.0 * scans[step])
        assert np.quantile(errors, 0.9) < 0.01
        assert np.median(errors) < 0.002


def test_links_are_those_of_the_recording(visit: Visit, shown: dict[str, Path]) -> None:
    dataset = Dataset.open(shown["peer"])
    episode = dataset[0]
    attempted = attempted_links(episode, dataset.task)
    assert attempted is not None
    visit.open("datasets/coop_nav-peer-v0.html#episode=0")

    for step in range(len(episode) + 1):
        found = {
            name: visit.run(f"swarmdata.views[0].replay.links('{name}', {step})")
            for name in ("heard", "lost")
        }
        lost = attempted[step] & ~episode.delivered[step] & ~np.eye(4, dtype=bool)
        heard = episode.delivered[step] & ~np.eye(4, dtype=bool)
        assert sorted(found["heard"]) == np.argwhere(heard).tolist()
        assert sorted(found["lost"]) == np.argwhere(lost).tolist()
    assert "0.2 s late" in visit.texts(".legend")[0]


@pytest.mark.parametrize("name", ["formation", "transport", "warehouse"])
def test_every_task_is_drawn_with_every_option(visit: Visit, name: str) -> None:
    visit.open(f"datasets/{name}-small-v0.html#t=1.3")
    blank = visit.run("swarmdata.views[0].canvas.toDataURL()")
    for option in visit.run(
        "[...document.querySelectorAll('[data-option]')].map((each) => each.dataset.option)"
    ):
        visit.page.click(f"[data-option={option}]")
    assert visit.run("swarmdata.views[0].canvas.toDataURL()") != blank


def test_events_lead_to_their_time(visit: Visit) -> None:
    visit.open(f"datasets/{TINY.id}.html#episode=2")
    visit.page.click(".events summary")
    times = visit.texts(".events button")
    assert times
    visit.page.click(".events button >> nth=-1")

    assert f"{visit.run('swarmdata.player.time'):.1f} s" == times[-1]


def test_a_recording_shows_lines_and_images(visit: Visit) -> None:
    visit.open("datasets/painting_v1-mine-v0.html#episode=1&t=5")
    assert [text.lower() for text in visit.texts(".lines h3")] == ["reward", "action"]
    assert visit.page.locator(".stage > figure:first-child .lines path").count() == 4
    colors = visit.run(
        "swarmdata.screens[0].pictures.canvases.map((canvas) =>"
        " [...canvas.getContext('2d').getImageData(6, 5, 1, 1).data])"
    )
    assert colors == [[255, 20, 20, 255], [20, 255, 20, 255]]
    visit.page.keyboard.press("ArrowRight")
    assert "step 6 of 9" in visit.texts(".clock")[0]

    visit.page.click(".compare")
    visit.page.select_option("select[name=dataset]", "painting_v1-more-v0")
    visit.wait("location.hash.includes('with=painting_v1-more-v0')")
    visit.run("swarmdata.player.seek(3)")
    captions = visit.texts(".stage .outcome")
    assert captions[0].startswith("episode 1 ")
    assert captions[1].startswith("episode 2 "), "no episode has the same seed"
    marks = visit.run(
        "swarmdata.screens.map((each) => each.plots.marks[0].mark.getAttribute('x1'))"
    )
    assert marks[0] == marks[1] != "0"


def test_code_is_copied(visit: Visit) -> None:
    visit.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    visit.open(f"datasets/{TINY.id}.html")
    visit.page.click("button[data-copies=copy-python]")
    visit.page.wait_for_selector("button:has-text('Copied')")

    assert "swarmdata.load(" in visit.run("navigator.clipboard.readText()")


def test_the_leaderboard_is_sorted_and_filtered(visit: Visit) -> None:
    visit.open("results.html#dataset=coop_nav-medium-v1")
    board = ".leaderboard:not([hidden])"
    assert visit.texts(f"{board} h2") == ["coop_nav-medium-v1"]
    script = (
        f"[...document.querySelector('{board}').querySelectorAll('tbody tr')]"
        ".map((row) => Number(row.cells[{}].dataset.value))"
    )
    assert visit.run(script.format(1)) == sorted(visit.run(script.format(1)), reverse=True)
    for name, column, best in (("success (%)", 3, max), ("robot collisions", 5, min)):
        visit.page.click(f"{board} thead button:has-text('{name}') >> nth=0")
        values = visit.run(script.format(column))
        assert values == sorted(values, reverse=best is max)
        assert values[0] == best(values)
    visit.page.fill("input[name=search]", "maddpg_bc")
    rows = visit.page.locator(f"{board} tbody tr:visible")
    assert rows.count() == 1
    address = visit.page.url
    visit.page.select_option("select[name=dataset]", "coop_nav-expert-v1")
    assert visit.texts(f"{board} h2") == ["coop_nav-expert-v1"]
    visit.page.go_back()
    visit.wait("document.querySelector('select[name=dataset]').value === 'coop_nav-medium-v1'")
    assert visit.page.url == address
    visit.page.fill("input[name=search]", "no such algorithm")
    assert visit.texts("#widen button")[-1] == "Clear all filters"


def test_injected_scripts_do_not_run(visit: Visit) -> None:
    visit.open("index.html")
    inject = (
        "document.body.insertAdjacentHTML('beforeend', '<img src=\"data:,\" onerror=\"hit=1\">')"
    )
    with visit.page.expect_console_message(lambda note: "inline event handler" in note.text):
        visit.run(inject)

    assert visit.run("typeof hit") == "undefined"
    visit.complaints.clear()


def test_missing_data_are_said(visit: Visit, tmp_path: Path) -> None:
    copy = tmp_path / "site"
    shutil.copytree(visit.site, copy)
    (copy / "data" / TINY.id / "0.js").unlink()
    visit.page.goto(f"{copy.as_uri()}/datasets/{TINY.id}.html")
    visit.page.wait_for_selector("#notice:has-text('is missing')")

    visit.complaints.clear()  # the browser's own note of the file
    visit.requests.clear()


def test_everything_that_can_be_used_has_a_name(visit: Visit) -> None:
    for path in ("index.html", "results.html", f"datasets/{TINY.id}.html"):
        visit.open(path)
        nameless = visit.run(
            "[...document.querySelectorAll('button, input, select, canvas, svg[role=img], a')]"
            ".filter((each) => !each.closest('[hidden]') && !(each.getAttribute('aria-label') ||"
            " each.textContent.trim() || (each.labels && each.labels.length)))"
            ".map((each) => each.outerHTML.slice(0, 120))"
        )
        assert nameless == []


def test_values_that_are_not_finite_are_no_bars_and_in_no_range(visit: Visit) -> None:
    visit.open("datasets/painting_v1-mine-v0.html")

    found = visit.run(
        "(() => { const one = new swarmdata.Histogram('a', 'A', [NaN, 1, 2], () => {});"
        " one.draw(new Set([0, 1, 2])); const before = one.accepts(0);"
        " one.fields[0].value = '1';"
        " return [before, one.accepts(0), one.accepts(1),"
        " one.plot.querySelectorAll('[height=\"58\"].all').length] })()"
    )

    assert found == [True, False, True, 2]


def test_a_result_leads_to_its_episodes_and_replays(visit_results: Visit) -> None:
    visit = visit_results
    visit.open(f"results.html#dataset={TINY.id}")
    with visit.page.expect_navigation():
        visit.page.click(".leaderboard:not([hidden]) tbody th a")
    visit.page.wait_for_selector("body[data-ready=yes]")
    assert visit.page.locator(".rows tbody tr").count() == 10
    rows = visit.run("swarmdata.table.rows.map((row) => [row.position, row.return])")
    n_replays = 6
    for position, value in rows[:n_replays]:
        visit.run(f"location.hash = '#episode=' + swarmdata.table.rows[{position}].index")
        visit.wait(f"swarmdata.views[0].replay.position === {position}")
        assert visit.run("swarmdata.views[0].replay.returns.at(-1)") == pytest.approx(
            value, abs=0.05
        )
    visit.run(f"swarmdata.table.onOpen({n_replays})")
    visit.wait("notice.textContent.includes('swarmdata render')")


def test_episodes_of_a_committed_study_are_listed(visit: Visit) -> None:
    visit.open("results/result-goals-bc-coop_nav-medium-v1.html")
    assert visit.texts(".count") == ["5000 of 5000 episodes"]
    visit.page.select_option("select[name=policy]", "training seed 3")
    assert visit.texts(".count") == ["1000 of 5000 episodes"]
    shares = visit.run("swarmdata.table.kept.filter((row) => row.end === 'success').length / 1000")
    mean = visit.texts("table tbody tr:has-text('training seed 3') td")
    assert f"{100 * shares:.1f}" in mean
    visit.page.click(".rows tbody tr >> nth=2")
    assert "Episode 2 of training seed 3 has no replay" in visit.texts("#notice")[0]
