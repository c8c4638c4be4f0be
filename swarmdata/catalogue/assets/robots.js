// Draws robots: trails, bodies with the mark of their role along the heading, halos of contacts.
"use strict";
swarmdata.robots = (() => {
  const TRAIL_SECONDS = 4;
  const WEDGE = [[0.75, 0], [-0.4, 0.5], [-0.15, 0], [-0.4, -0.5]];
  const TRIANGLE = [[0.55, 0], [-0.35, 0.42], [-0.35, -0.42]];
  const CHEVRON = [[0.3, 0], [-0.1, 0.55], [-0.36, 0.55], [0, 0], [-0.36, -0.55], [-0.1, -0.55]];
  const MARKS = [WEDGE, TRIANGLE, CHEVRON, WEDGE.map(([a, l]) => [0.7 * a, 0.7 * l])];

  function trails(pen, replay, step) {
    const last = Math.floor(step);
    const recent = Math.max(0, last - Math.round(TRAIL_SECONDS / pen.world.dt));
    pen.world.robots.forEach((_, i) => {
      const stroke = pen.world.colors[i];
      const places = [];
      for (let t = 0; t <= last; t++) places.push([replay.value("x", i, t), replay.value("y", i, t)]);
      places.push(replay.place(i, step));
      pen.path(places.slice(0, recent + 1), { stroke, alpha: 0.22, width: 0.012 });
      const pieces = 8;
      for (let k = 0; k < pieces; k++) {
        const from = recent + Math.floor(((places.length - 1 - recent) * k) / pieces);
        const to = recent + Math.floor(((places.length - 1 - recent) * (k + 1)) / pieces);
        const share = (k + 1) / pieces;
        const style = { stroke, alpha: 0.2 + 0.55 * share, width: 0.012 + 0.026 * share, cap: "butt" };
        if (to > from) pen.path(places.slice(from, to + 1), style);
      }
    });
  }

  function halos(pen, replay, step) {
    const at = Math.min(Math.ceil(step), replay.length);
    pen.world.robots.forEach((robot, i) => {
      const [x, y] = replay.place(i, step);
      const contact = replay.contact(i, at);
      if (contact.touches) pen.disc(x, y, 1.5 * robot.radius, { fill: pen.colors.contact });
    });
  }

  function mark(pen, robot, x, y, heading) {
    const { radius } = robot;
    const white = "#ffffff";
    const role = robot.role % 4;
    if (role === 1) pen.disc(x, y, 0.8 * radius, { stroke: white, width: 0.13 * radius });
    if (role === 3) pen.disc(x, y, 0.76 * radius, { fill: "#2d333c" });
    if (heading === null) {
      pen.disc(x, y, 0.24 * radius, { fill: white });
      return;
    }
    const corners = MARKS[role].map(([a, l]) => [a * radius, l * radius]);
    pen.turned(corners, x, y, heading, { fill: white });
  }

  function bodies(pen, replay, step, options) {
    halos(pen, replay, step);
    pen.world.robots.forEach((robot, i) => {
      const [x, y] = replay.place(i, step);
      pen.disc(x, y, 1.1 * robot.radius, { fill: pen.colors.floor });
      pen.disc(x, y, robot.radius, { fill: pen.world.colors[i] });
      if (options.numbers) pen.label(String(i), x, y, 1.15 * robot.radius, "#ffffff");
      else mark(pen, robot, x, y, replay.heading(i, step));
      if (replay.has("carrying") && replay.code("carrying", i, Math.floor(step))) {
        const half = 0.42 * robot.radius;
        const at = [x + 0.75 * robot.radius, y + 0.75 * robot.radius];
        pen.rectangle(...at, 0, half, half, { fill: pen.colors.payload, stroke: pen.colors.payloadEdge, width: 0.014 });
      }
    });
  }

  return { trails, bodies };
})();
