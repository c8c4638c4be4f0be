// Draws what robots sense and say: ranges and beams, messages that arrived, came late or were lost.
"use strict";
swarmdata.signals = (() => {
  const CROWDED = 5; // links for each robot above which only their ends are drawn
  const BEND = 0.13; // of a link's length, to the left of each direction

  function sensors(pen, replay, step) {
    const { sensor, robots, colors } = pen.world;
    robots.forEach((_, i) => {
      const [x, y] = replay.place(i, step);
      const line = { stroke: colors[i], alpha: 0.5, width: 0.01, dash: [0.04, 0.05] };
      if (sensor.kind === "occupancy") {
        const angle = robots[i].turns ? replay.heading(i, step) : 0;
        pen.rectangle(x, y, angle, sensor.half, sensor.half, line);
      } else if (sensor.ranges[i] !== null) {
        pen.disc(x, y, sensor.ranges[i], line);
      }
      if (sensor.kind === "lidar") beams(pen, replay, i, step);
    });
  }

  function beams(pen, replay, i, step) {
    const [x, y] = replay.place(i, step);
    const color = pen.world.colors[i];
    for (const { angle, distance, hits } of swarmdata.rays.cast(replay, i, step)) {
      const end = [x + distance * Math.cos(angle), y + distance * Math.sin(angle)];
      pen.path([[x, y], end], { stroke: color, alpha: hits ? 0.5 : 0.2, width: 0.008 });
      if (hits) pen.disc(...end, 0.026, { fill: color });
    }
  }

  // A curve from rim to rim; where links are crowded, a short straight line at the receiver.
  function curve(pen, replay, step, receiver, sender, crowded) {
    const [a, b] = [replay.place(sender, step), replay.place(receiver, step)];
    const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    const length = Math.max(1e-9, Math.hypot(dx, dy));
    const bend = crowded ? 0 : 2 * BEND;
    const middle = [(a[0] + b[0]) / 2 - bend * dy, (a[1] + b[1]) / 2 + bend * dx];
    const { robots } = pen.world;
    let first = Math.min(0.45, (1.25 * robots[sender].radius) / length);
    const last = Math.max(0.55, 1 - (1.3 * robots[receiver].radius) / length);
    if (crowded) first = Math.max(first, last - 0.3 / length);
    return Array.from({ length: 17 }, (_, k) => {
      const t = first + ((last - first) * k) / 16;
      return [0, 1].map((c) => (1 - t) ** 2 * a[c] + 2 * t * (1 - t) * middle[c] + t * t * b[c]);
    });
  }

  function arrow(pen, points, color) {
    const [tail, tip] = points.slice(-2);
    const angle = Math.atan2(tip[1] - tail[1], tip[0] - tail[0]);
    pen.turned([[0, 0], [-0.08, 0.036], [-0.08, -0.036]], ...tip, angle, { fill: color });
  }

  function messages(pen, replay, step) {
    const at = Math.floor(step);
    const [heard, lost] = [replay.links("heard", at), replay.links("lost", at)];
    const crowded = heard.length + lost.length > CROWDED * pen.world.robots.length;
    for (const [receiver, sender] of lost) {
      const points = curve(pen, replay, step, receiver, sender, crowded).slice(0, crowded ? 17 : 11);
      const color = pen.colors.lost;
      pen.path(points, { stroke: color, width: 0.014, dash: [0.04, 0.05] });
      const [x, y] = points[points.length - 1];
      for (const s of [1, -1]) {
        pen.path([[x - 0.035, y - 0.035 * s], [x + 0.035, y + 0.035 * s]], { stroke: color, width: 0.018 });
      }
    }
    const late = pen.world.radio.delay > 0;
    for (const [receiver, sender] of heard) {
      const points = curve(pen, replay, step, receiver, sender, crowded);
      const color = pen.world.colors[sender];
      pen.path(points, { stroke: color, alpha: 0.8, width: 0.014, dash: late ? [0.015, 0.04] : [] });
      arrow(pen, points, color);
    }
  }

  return { sensors, messages };
})();
