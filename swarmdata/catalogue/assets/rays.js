// Where the beams of a lidar end: computed from the positions, without the noise of the sensor.
"use strict";
swarmdata.rays = (() => {
  const CIRCLE = 0;

  // Bars of an obstacle in its own frame, as centre and half sizes: see numerics/geometry.py.
  function bars(shape) {
    const { kind, a, b, t } = shape;
    if (kind === 1) return [[0, 0, a, b]];
    const found = [
      [0, t - b, a, t],
      [t - a, 0, t, b],
    ];
    if (kind === 3) found.push([a - t, 0, t, b]);
    return found;
  }

  // Distance along a unit vector from a point to a disc, Infinity if it misses.
  function toDisc(px, py, dx, dy, x, y, radius) {
    const along = (x - px) * dx + (y - py) * dy;
    const square = (x - px) ** 2 + (y - py) ** 2 - along ** 2;
    if (square > radius * radius) return Infinity;
    const distance = along - Math.sqrt(radius * radius - square);
    return distance >= 0 ? distance : Infinity;
  }

  // Distance to a rectangle that is centred at (x, y) and turned by an angle.
  function toBar(px, py, dx, dy, frame, bar) {
    const { x, y, angle } = frame;
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const local = [(px - x) * cos + (py - y) * sin - bar[0], (py - y) * cos - (px - x) * sin - bar[1]];
    const ahead = [dx * cos + dy * sin, dy * cos - dx * sin];
    let [enter, leave] = [0, Infinity];
    for (const axis of [0, 1]) {
      const half = bar[2 + axis];
      if (Math.abs(ahead[axis]) < 1e-12) {
        if (Math.abs(local[axis]) > half) return Infinity;
        continue;
      }
      const ends = [(-half - local[axis]) / ahead[axis], (half - local[axis]) / ahead[axis]];
      enter = Math.max(enter, Math.min(...ends));
      leave = Math.min(leave, Math.max(...ends));
    }
    return enter <= leave ? enter : Infinity;
  }

  function toWall(px, py, dx, dy, halfWidth, halfHeight) {
    const x = dx > 0 ? (halfWidth - px) / dx : dx < 0 ? (-halfWidth - px) / dx : Infinity;
    const y = dy > 0 ? (halfHeight - py) / dy : dy < 0 ? (-halfHeight - py) / dy : Infinity;
    return Math.min(x, y);
  }

  function toShape(px, py, dx, dy, shape) {
    if (shape.kind === CIRCLE) return toDisc(px, py, dx, dy, shape.x, shape.y, shape.a);
    return Math.min(...bars(shape).map((bar) => toBar(px, py, dx, dy, shape, bar)));
  }

  // The bodies that robots push, as shapes.
  function payloads(replay, step) {
    return replay.world.payloads.map((model, k) => {
      const [x, y] = [replay.between("body", 2 * k, step), replay.between("body", 2 * k + 1, step)];
      const angle = replay.between("body_angle", k, step);
      return { kind: model.shape === "circle" ? CIRCLE : 1, x, y, angle, a: model.a, b: model.b, t: 0 };
    });
  }

  // Distances of the beams of robot i, m; the first is along its heading, then counter-clockwise.
  function cast(replay, i, step) {
    const { world } = replay;
    const [px, py] = replay.place(i, step);
    const reach = world.sensor.ranges[i];
    const first = world.robots[i].turns ? replay.heading(i, step) : 0;
    const shapes = [...replay.obstacles(), ...payloads(replay, step)];
    world.robots.forEach((robot, k) => {
      const [x, y] = replay.place(k, step);
      if (k !== i) shapes.push({ kind: CIRCLE, x, y, a: robot.radius });
    });
    return Array.from({ length: world.sensor.rays }, (_, k) => {
      const angle = first + (2 * Math.PI * k) / world.sensor.rays;
      const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
      const wall = toWall(px, py, dx, dy, world.width / 2, world.height / 2);
      const nearest = Math.min(wall, ...shapes.map((shape) => toShape(px, py, dx, dy, shape)));
      return { angle, distance: Math.min(nearest, reach), hits: nearest < reach };
    });
  }

  return { cast, bars, payloads };
})();
