// The page of a dataset of our worlds: replays, alone or side by side, and the table beside them.
"use strict";
(async () => {
  const { page, el, data, link } = swarmdata;
  const viewer = document.getElementById("viewer");
  const notice = document.getElementById("notice");
  const figures = [...viewer.querySelectorAll("figure")];
  const views = figures.map((figure) => new swarmdata.View(figure));
  const tracks = [...viewer.querySelectorAll(".track")];
  const toggles = [...viewer.querySelectorAll("input[data-option]")];
  const pickDataset = viewer.querySelector("select[name=dataset]");
  const pickEpisode = viewer.querySelector("input[name=other]");
  const compare = viewer.querySelector(".compare");
  const shown = [{ key: page.key, position: 0 }, null];
  let episodes = null;

  const options = () => Object.fromEntries(toggles.map((each) => [each.dataset.option, each.checked]));
  const screenOf = (view) => ({
    duration: view.replay.duration,
    dt: view.replay.world.dt,
    at: (time) => {
      view.at(time / view.replay.world.dt, options());
      view.mark(time);
    },
  });
  const player = new swarmdata.Player(viewer, () => remember());

  const own = await load(() => data.table(page.key));
  if (!own) return;
  const indexOf = (table, position) => table.episodes.index[position];

  async function load(action) {
    try {
      return await action();
    } catch (error) {
      notice.textContent = error.message;
      return null;
    }
  }

  function remember() {
    if (!views[0].replay) return;
    const address = { episode: indexOf(own, shown[0].position), time: player.time };
    if (shown[1]) Object.assign(address, { key: shown[1].key, other: shown[1].index });
    link.write(address);
  }

  function describe(table, position) {
    const { episodes: column } = table;
    const collisions = column.robot_collisions[position] + column.obstacle_collisions[position];
    return `episode ${column.index[position]} · ${column.policies[column.policy[position]]} · ` +
      `${swarmdata.outcomes[column.ends[column.end[position]]]} · return ${column.return[position].toFixed(2)} · ` +
      `${collisions} collision${collisions === 1 ? "" : "s"}`;
  }

  async function open(which, key, position) {
    const found = await load(async () => [await data.table(key), await data.arrays(key, position)]);
    if (!found) return;
    const [table, arrays] = found;
    shown[which] = { key, position, index: indexOf(table, position) };
    const view = views[which];
    view.show(new swarmdata.Replay(table, position, arrays));
    view.canvas.setAttribute("aria-label", `Replay of ${key}, ${describe(table, position)}`);
    view.caption.textContent = describe(table, position);
    if (which === 0) episodes.setCurrent(position);
    refresh();
  }

  function refresh() {
    const active = views.filter((view, k) => view.replay && shown[k]);
    if (!active.length) return;
    const duration = Math.max(...active.map((view) => view.replay.duration));
    views.forEach((view, k) => {
      tracks[k].toggleAttribute("hidden", !active.includes(view));
      if (active.includes(view)) view.mark = swarmdata.drawTrack(tracks[k], view.replay, duration);
    });
    player.setScreens(active.map(screenOf));
    const go = (time) => {
      player.pause();
      player.seek(time);
    };
    swarmdata.listEvents(viewer.querySelector(".events"), active.map((view) => view.replay), go);
  }

  // An episode of a dataset; of another one that of the same seed, where it has it.
  async function beside(key, index) {
    const table = await load(() => data.table(key));
    if (!table) return;
    let position = table.episodes.index.indexOf(index);
    const seed = own.episodes.seed[shown[0].position];
    const same = table.episodes.seed.indexOf(seed);
    const last = table.episodes.index.length - 1;
    if (index === null) position = key !== page.key && same >= 0 ? same : Math.min(shown[0].position + 1, last);
    if (position < 0) {
      notice.textContent = `Episode ${index} of ${key} is not among those shown.`;
      return;
    }
    notice.textContent = key !== page.key && position === same ? "Both episodes have the same seed." : "";
    pickDataset.value = key;
    pickEpisode.value = indexOf(table, position);
    figures[1].hidden = false;
    viewer.classList.add("two");
    compare.setAttribute("aria-pressed", "true");
    compare.textContent = "Close second view";
    await open(1, key, position);
    remember();
  }

  function alone() {
    shown[1] = null;
    figures[1].hidden = true;
    viewer.classList.remove("two");
    compare.setAttribute("aria-pressed", "false");
    compare.textContent = "Side by side";
    notice.textContent = "";
    refresh();
  }

  async function follow() {
    const wanted = link.read();
    let position = wanted.episode === null ? 0 : own.episodes.index.indexOf(wanted.episode);
    notice.textContent = "";
    if (position < 0) {
      notice.textContent = `Episode ${wanted.episode} is not among the ${own.episodes.index.length} shown.`;
      position = 0;
    }
    player.pause();
    const time = wanted.time || 0;
    await open(0, page.key, position);
    if (wanted.key && [page.key, ...page.peers].includes(wanted.key)) await beside(wanted.key, wanted.other);
    player.seek(time);
  }

  async function choose(position) {
    if (position === null) return;
    player.pause();
    await open(0, page.key, position);
    player.seek(0);
  }

  episodes = new swarmdata.EpisodeTable(document.getElementById("browse"), own, async (position) => {
    await choose(position);
    player.button.focus({ preventScroll: true }); // so that Space plays what was chosen
  });
  for (const key of [page.key, ...page.peers]) pickDataset.append(el("option", { value: key }, key));
  compare.addEventListener("click", () => (shown[1] ? alone() : beside(page.key, null)));
  pickDataset.addEventListener("change", () => beside(pickDataset.value, null));
  pickEpisode.addEventListener("change", () => beside(pickDataset.value, Number(pickEpisode.value)));
  for (const track of tracks) {
    track.addEventListener("pointerdown", (event) => {
      const box = track.getBoundingClientRect();
      player.seek(((event.clientX - box.left) / box.width) * player.duration);
    });
  }
  for (const toggle of toggles) toggle.addEventListener("change", () => player.move(player.time));
  viewer.querySelector(".previous").addEventListener("click", () => choose(episodes.neighbor(-1)));
  viewer.querySelector(".next").addEventListener("click", () => choose(episodes.neighbor(1)));
  viewer.querySelector(".share").addEventListener("click", (event) => {
    remember();
    swarmdata.copyFrom(event.currentTarget, location.href);
  });
  addEventListener("hashchange", follow);
  await follow();
  Object.assign(swarmdata, { player, views, table: episodes });
  document.body.dataset.ready = "yes";
})();
