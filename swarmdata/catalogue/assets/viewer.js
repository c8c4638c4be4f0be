// What all viewers of episodes share: opening them, alone or side by side, links, buttons, the table.
//
// `screens` are the two places for an episode, each with
//   load(key, table, position)   a promise: fetches an episode and shows it,
//   name(text)                   says what is shown,
//   duration, dt, at(time)       of what is shown.
// `describe(table, position)` is what an episode is called; `refresh(active)` is called with the
// screens that show one whenever they change.
"use strict";
swarmdata.startViewer = async ({ screens, describe, refresh }) => {
  const { page, el, data, link } = swarmdata;
  const viewer = document.getElementById("viewer");
  const notice = document.getElementById("notice");
  const figures = [...viewer.querySelectorAll(".stage > figure")];
  const pickDataset = viewer.querySelector("select[name=dataset]");
  const pickEpisode = viewer.querySelector("input[name=other]");
  const compare = viewer.querySelector(".compare");
  const shown = [null, null]; // of each screen: { key, position, index }
  let episodes = null;
  const player = new swarmdata.Player(viewer, () => remember());

  async function attempt(action) {
    try {
      return await action();
    } catch (error) {
      notice.textContent = error.message;
      return null;
    }
  }

  const own = await attempt(() => data.table(page.key));
  if (!own) return;
  const indexOf = (table, position) => table.episodes.index[position];

  function remember() {
    if (!shown[0]) return;
    const address = { episode: shown[0].index, time: player.time };
    if (shown[1]) Object.assign(address, { key: shown[1].key, other: shown[1].index });
    link.write(address);
  }

  // A measured episode whose policy is not at hand has numbers, but no replay.
  function isAbsent(table, position) {
    if (table.replays === undefined || position < table.replays) return false;
    notice.textContent = swarmdata.absent(table, position);
    return true;
  }

  async function open(which, key, position) {
    const table = await attempt(async () => {
      const found = await data.table(key);
      if (isAbsent(found, position)) return null;
      await screens[which].load(key, found, position);
      return found;
    });
    if (!table) return;
    shown[which] = { key, position, index: indexOf(table, position) };
    screens[which].name(key, describe(table, position));
    if (which === 0) episodes.setCurrent(position);
    update();
  }

  function update() {
    const active = screens.filter((_, k) => shown[k]);
    refresh(active, player);
    player.setScreens(active);
  }

  // An episode of a dataset; of another one that of the same seed, where it has it.
  async function beside(key, index) {
    const table = await attempt(() => data.table(key));
    if (!table) return;
    let position = table.episodes.index.indexOf(index);
    const same = table.episodes.seed.indexOf(own.episodes.seed[shown[0].position]);
    const last = (table.replays || table.episodes.index.length) - 1;
    if (index === null) position = key !== page.key && same >= 0 ? same : Math.min(shown[0].position + 1, last);
    if (position < 0) {
      notice.textContent = `Episode ${index} of ${key} is not among those shown.`;
      return;
    }
    if (isAbsent(table, position)) return;
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
    update();
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
    notice.textContent = "";
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
  viewer.querySelector(".previous").addEventListener("click", () => choose(episodes.neighbor(-1)));
  viewer.querySelector(".next").addEventListener("click", () => choose(episodes.neighbor(1)));
  viewer.querySelector(".share").addEventListener("click", (event) => {
    remember();
    swarmdata.copyFrom(event.currentTarget, location.href);
  });
  swarmdata.onAddress(follow);
  Object.assign(swarmdata, { player, table: episodes });
  await follow();
  document.body.dataset.ready = "yes";
};
