// The page of a dataset of another environment: its arrays over time, and its images if it has any.
"use strict";
(() => {
  const viewer = document.getElementById("viewer");

  // Plots and images of one episode.
  class Screen {
    constructor(figure) {
      this.plots = new swarmdata.LinePlots(figure.querySelector(".lines"));
      this.place = figure.querySelector(".pictures");
      this.caption = figure.querySelector(".outcome");
      this.dt = 1;
    }

    async load(key, table, position) {
      const arrays = await swarmdata.data.arrays(key, position);
      const hasImages = table.series.image && position < table.images.length;
      const states = hasImages ? table.images[position] : null;
      const values = states ? await swarmdata.data.pixels(key, position, states.length) : null;
      this.plots.show(table.series, arrays);
      this.pictures = table.series.image ? new swarmdata.Pictures(this.place, table.series) : null;
      this.place.hidden = !this.pictures;
      if (this.pictures) this.pictures.show(states, values);
      this.duration = table.episodes.length[position];
    }

    name(key, text) {
      this.caption.textContent = text;
    }

    at(time) {
      this.plots.at(Math.min(time, this.duration));
      if (this.pictures) this.pictures.at(Math.floor(Math.min(time, this.duration)));
    }
  }

  const screens = [...viewer.querySelectorAll(".stage > figure")].map((figure) => new Screen(figure));

  function describe(table, position) {
    const { episodes: column } = table;
    return `episode ${column.index[position]} · ${column.policies[column.policy[position]]} · ` +
      `return ${column.return[position].toFixed(2)}`;
  }

  // Two episodes side by side have the same axes.
  function refresh(active) {
    const all = active.map((screen) => screen.plots);
    for (const screen of active) screen.plots.draw(all);
  }

  swarmdata.screens = screens;
  swarmdata.startViewer({ screens, describe, refresh });
})();
