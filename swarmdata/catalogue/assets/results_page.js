// The leaderboards: one dataset at a time, and of its rows those that are chosen.
"use strict";
(() => {
  const boards = [...document.querySelectorAll(".leaderboard")];
  const rowsOf = (board) => [...board.querySelectorAll("tbody tr")];

  swarmdata.startFilters({
    items: (values) => rowsOf(boards.find((board) => board.dataset.dataset === values.dataset)),
    accepts(row, values) {
      const words = values.search.toLowerCase().split(/\s+/).filter(Boolean);
      if (values.group !== "all" && row.dataset.group !== values.group) return false;
      return words.every((word) => row.dataset.text.includes(word));
    },
    show(kept, values) {
      const chosen = new Set(kept);
      for (const board of boards) {
        board.hidden = board.dataset.dataset !== values.dataset;
        if (!board.hidden) for (const row of rowsOf(board)) row.hidden = !chosen.has(row);
        board.querySelector(".wide").hidden = !kept.length;
      }
    },
  });
})();
