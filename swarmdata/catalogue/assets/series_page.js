// The page of a dataset of another environment: its arrays over time, and its images if it has any.
"use strict";
(async () => {
  const { page, data, link } = swarmdata;
  const viewer = document.getElementById("viewer");
  const notice = document.getElementById("notice");
  const player = new swarmdata.Player(viewer, () => remember());
  let position = 0;
  let table = null;

  function remember() {
    if (table) link.write({ episode: table.episodes.index[position], time: player.time });
  }

  try {
    table = await data.table(page.key);
  } catch (error) {
    notice.textContent = error.message;
    return;
  }
  const plots = new swarmdata.LinePlots(document.getElementById("plots"), table.series);
  const place = document.getElementById("pictures");
  const pictures = table.series.image ? new swarmdata.Pictures(place, table.series) : null;

  async function open(wanted) {
    try {
      const arrays = await data.arrays(page.key, wanted);
      const states = pictures && wanted < table.images.length ? table.images[wanted] : null;
      const values = states ? await data.pixels(page.key, wanted, states.length) : null;
      position = wanted;
      plots.show(arrays);
      if (pictures) pictures.show(states, values);
    } catch (error) {
      notice.textContent = error.message;
      return;
    }
    const column = table.episodes;
    viewer.querySelector(".outcome").textContent =
      `episode ${column.index[wanted]} · ${column.policies[column.policy[wanted]]} · return ${column.return[wanted].toFixed(2)}`;
    const at = (time) => {
      plots.at(time);
      if (pictures) pictures.at(Math.floor(time));
    };
    player.setScreens([{ duration: column.length[wanted], dt: 1, at }]);
    episodes.setCurrent(wanted);
  }

  async function choose(wanted) {
    if (wanted === null) return;
    player.pause();
    await open(wanted);
    player.seek(0);
  }

  async function follow() {
    const wanted = link.read();
    const found = wanted.episode === null ? 0 : table.episodes.index.indexOf(wanted.episode);
    notice.textContent = found < 0 ? `Episode ${wanted.episode} is not among those shown.` : "";
    player.pause();
    await open(Math.max(0, found));
    player.seek(wanted.time || 0);
  }

  const episodes = new swarmdata.EpisodeTable(document.getElementById("browse"), table, async (position) => {
    await choose(position);
    player.button.focus({ preventScroll: true }); // so that Space plays what was chosen
  });
  viewer.querySelector(".previous").addEventListener("click", () => choose(episodes.neighbor(-1)));
  viewer.querySelector(".next").addEventListener("click", () => choose(episodes.neighbor(1)));
  viewer.querySelector(".share").addEventListener("click", (event) => {
    remember();
    swarmdata.copyFrom(event.currentTarget, location.href);
  });
  addEventListener("hashchange", follow);
  await follow();
  Object.assign(swarmdata, { player, table: episodes });
  document.body.dataset.ready = "yes";
})();
