// The page of a result without replays: the table of its episodes.
"use strict";
(async () => {
  const notice = document.getElementById("notice");
  try {
    const table = await swarmdata.data.table(swarmdata.page.key);
    const root = document.getElementById("browse");
    swarmdata.table = new swarmdata.EpisodeTable(root, table, (position) => {
      notice.textContent = swarmdata.absent(table, position);
      swarmdata.table.setCurrent(position);
    });
  } catch (error) {
    notice.textContent = error.message;
    return;
  }
  document.body.dataset.ready = "yes";
})();
