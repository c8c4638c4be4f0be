// The list of events below a replay: each leads to its time.
"use strict";
swarmdata.listEvents = (details, replays, seek) => {
  const { el } = swarmdata;
  const side = (k) => (replays.length > 1 ? ["left: ", "right: "][k] : "");
  const timed = replays.flatMap((replay, k) =>
    replay.events.map((event) => ({ ...event, k, time: event.step * replay.world.dt })),
  );
  timed.sort((a, b) => a.time - b.time);
  const items = timed.map(({ time, kind, text, k }) => {
    const go = el("button", { type: "button", class: kind }, `${time.toFixed(1)} s`);
    go.addEventListener("click", () => seek(time));
    return el("li", {}, go, ` ${side(k)}${text}`);
  });
  details.querySelector("ol").replaceChildren(...items);
  details.querySelector("summary").textContent = `Events (${items.length})`;
};
