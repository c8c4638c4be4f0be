// The strip above the time bar: the return so far, a tick for each event, and where time is.
// Returns what moves the mark of the present time.
"use strict";
swarmdata.drawTrack = (svgNode, replay, duration) => {
  const { svg } = swarmdata;
  const [width, height] = [1000, 40];
  svgNode.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svgNode.setAttribute("preserveAspectRatio", "none");
  const x = (step) => ((step * replay.world.dt) / duration) * width;
  const sums = replay.returns;
  const [low, high] = [Math.min(0, ...sums), Math.max(0, ...sums)];
  const y = (value) => height - 2 - ((value - low) / (high - low || 1)) * (height - 4);
  const line = Array.from(sums, (value, t) => `${t ? "L" : "M"}${x(t).toFixed(1)} ${y(value).toFixed(1)}`);
  const zero = svg("line", { x1: 0, x2: width, y1: y(0), y2: y(0), class: "zero" });
  const curve = svg("path", { d: line.join(""), class: "return" });
  const ticks = replay.events.map((event) =>
    svg("line", { x1: x(event.step), x2: x(event.step), y1: 0, y2: height, class: `tick ${event.kind}` }),
  );
  const now = svg("line", { y1: 0, y2: height, class: "now" });
  svgNode.replaceChildren(zero, curve, ...ticks, now);
  return (time) => {
    now.setAttribute("x1", (time / duration) * width);
    now.setAttribute("x2", (time / duration) * width);
  };
};
