// The page of a dataset of our worlds: replays on canvases, with their events.
"use strict";
(() => {
  const viewer = document.getElementById("viewer");
  const toggles = [...viewer.querySelectorAll("input[data-option]")];
  const tracks = [...viewer.querySelectorAll(".track")];
  const options = () => Object.fromEntries(toggles.map((each) => [each.dataset.option, each.checked]));

  // A canvas and the strip above the time bar.
  class Screen {
    constructor(figure, track) {
      this.view = new swarmdata.View(figure);
      this.track = track;
      this.mark = () => {};
    }

    async load(key, table, position) {
      const arrays = await swarmdata.data.arrays(key, position);
      this.view.show(new swarmdata.Replay(table, position, arrays));
    }

    name(key, text) {
      this.view.canvas.setAttribute("aria-label", `Replay of ${key}, ${text}`);
      this.view.caption.textContent = text;
    }

    get duration() {
      return this.view.replay.duration;
    }

    get dt() {
      return this.view.replay.world.dt;
    }

    at(time) {
      this.view.at(time / this.dt, options());
      this.mark(time);
    }
  }

  const figures = [...viewer.querySelectorAll(".stage > figure")];
  const screens = figures.map((figure, k) => new Screen(figure, tracks[k]));

  function describe(table, position) {
    const { episodes: column } = table;
    const collisions = column.robot_collisions[position] + column.obstacle_collisions[position];
    return `episode ${column.index[position]} · ${column.policies[column.policy[position]]} · ` +
      `${swarmdata.outcomes[column.ends[column.end[position]]]} · return ${column.return[position].toFixed(2)} · ` +
      `${collisions} collision${collisions === 1 ? "" : "s"}`;
  }

  function refresh(active, player) {
    const duration = Math.max(...active.map((screen) => screen.duration));
    for (const screen of screens) {
      screen.track.toggleAttribute("hidden", !active.includes(screen));
      if (active.includes(screen)) screen.mark = swarmdata.drawTrack(screen.track, screen.view.replay, duration);
    }
    const go = (time) => {
      player.pause();
      player.seek(time);
    };
    swarmdata.listEvents(viewer.querySelector(".events"), active.map((screen) => screen.view.replay), go);
  }

  for (const track of tracks) {
    track.addEventListener("pointerdown", (event) => {
      const box = track.getBoundingClientRect();
      swarmdata.player.seek(((event.clientX - box.left) / box.width) * swarmdata.player.duration);
    });
  }
  for (const toggle of toggles) {
    toggle.addEventListener("change", () => swarmdata.player.move(swarmdata.player.time));
  }
  swarmdata.views = screens.map((screen) => screen.view);
  swarmdata.startViewer({ screens, describe, refresh });
})();
