// Draws what does not act: floor, obstacles, goals, slots, the payload and where it should be.
"use strict";
swarmdata.marks = (() => {
  const SAME_PLACE = 0.01; // m; closer targets are one place, whose rings nest

  function floor(pen) {
    const { world, colors } = pen;
    const [w, h] = [world.width / 2, world.height / 2];
    pen.rectangle(0, 0, 0, w + pen.margin, h + pen.margin, { fill: colors.wall });
    pen.rectangle(0, 0, 0, w, h, { fill: colors.floor });
    const line = { stroke: colors.grid, width: 0.006 };
    for (let x = Math.ceil(-w); x < w; x++) pen.path([[x, -h], [x, h]], line);
    for (let y = Math.ceil(-h); y < h; y++) pen.path([[-w, y], [w, y]], line);
  }

  function obstacles(pen, replay) {
    const style = { fill: pen.colors.obstacle };
    for (const shape of replay.obstacles()) {
      if (shape.kind === 0) {
        pen.disc(shape.x, shape.y, shape.a, style);
        continue;
      }
      for (const [cx, cy, hx, hy] of swarmdata.rays.bars(shape)) {
        const [cos, sin] = [Math.cos(shape.angle), Math.sin(shape.angle)];
        const [x, y] = [shape.x + cx * cos - cy * sin, shape.y + cx * sin + cy * cos];
        pen.rectangle(x, y, shape.angle, hx, hy, style);
      }
    }
  }

  // A target that no robot knows yet is dotted.
  function ring(pen, x, y, radius, color, reached, known = true) {
    if (!known) {
      pen.disc(x, y, radius - 0.01, { stroke: color, width: 0.014, dash: [0.03, 0.05] });
      return;
    }
    if (reached) pen.disc(x, y, 1.35 * radius, { fill: color, alpha: 0.22 });
    pen.disc(x, y, radius, { fill: color, alpha: reached ? 0.4 : 0.1 });
    pen.disc(x, y, radius - 0.01, { stroke: color, width: 0.022 });
    if (!reached) pen.disc(x, y, 0.025, { fill: color });
  }

  // The radius of a robot's target; a target of no robot has the largest.
  function radiusOf(world, i) {
    if (world.target_radius !== null) return world.target_radius;
    return i === null ? Math.max(...world.robots.map((robot) => robot.radius)) : world.robots[i].radius;
  }

  // Dashes from robots to their targets, where a robot has one.
  function links(pen, replay, step) {
    const { world } = pen;
    if (!world.is_linked) return;
    world.robots.forEach((_, i) => {
      const [x, y] = targetOf(replay, i, step);
      const away = world.nowhere && Math.hypot(x - world.nowhere[0], y - world.nowhere[1]) < SAME_PLACE;
      const style = { stroke: world.colors[i], alpha: 0.45, width: 0.014, dash: [0.06, 0.06] };
      if (!away) pen.path([replay.place(i, step), [x, y]], style);
    });
  }

  function goals(pen, replay, step) {
    const { world } = pen;
    const places = world.robots.map((_, i) => replay.place(i, step));
    links(pen, replay, step);
    if (world.is_shared) {
      const radius = radiusOf(world, null);
      for (let k = 0; k < replay.count("goal") / 2; k++) {
        const [x, y] = [replay.value("goal", 2 * k), replay.value("goal", 2 * k + 1)];
        const reached = replay.has("reached")
          ? replay.value("reached", k, Math.floor(step)) > 0
          : places.some(([px, py]) => Math.hypot(px - x, py - y) <= radius);
        const known = !replay.has("known") || replay.value("known", k, Math.floor(step)) > 0;
        ring(pen, x, y, radius, pen.colors.neutral, reached, known);
      }
      return;
    }
    const targets = world.robots.map((_, i) => targetOf(replay, i, step));
    targets.forEach(([x, y], i) => {
      const shared = targets.slice(0, i).filter(([a, b]) => Math.hypot(a - x, b - y) < SAME_PLACE).length;
      const radius = radiusOf(world, i);
      const reached = Math.hypot(places[i][0] - x, places[i][1] - y) <= radius;
      ring(pen, x, y, radius * Math.max(0.25, 1 - 0.25 * shared), world.colors[i], reached);
    });
  }

  // Targets jump when an order ends, so they are not interpolated.
  function targetOf(replay, i, step) {
    const at = Math.floor(step);
    return [replay.value("tx", i, at), replay.value("ty", i, at)];
  }

  function slots(pen, replay, step) {
    const { world } = pen;
    world.robots.forEach((_, i) => {
      const color = world.colors[i];
      const [x, y] = [replay.between("tx", i, step), replay.between("ty", i, step)];
      const [px, py] = replay.place(i, step);
      const tolerance = radiusOf(world, i);
      if (Math.hypot(x - px, y - py) <= tolerance) {
        pen.disc(x, y, tolerance, { fill: color, alpha: 0.3 });
      } else if (world.is_linked) {
        pen.path([[px, py], [x, y]], { stroke: color, alpha: 0.45, width: 0.014, dash: [0.035, 0.05] });
      }
      for (const s of [1, -1]) {
        pen.path([[x - 0.07, y - 0.07 * s], [x + 0.07, y + 0.07 * s]], { stroke: color, width: 0.026 });
      }
    });
  }

  function outline(pen, shape, style) {
    if (shape.kind === 0) pen.disc(shape.x, shape.y, shape.a, style);
    else pen.rectangle(shape.x, shape.y, shape.angle, shape.a, shape.b, style);
  }

  function payloadGoal(pen, replay, step) {
    const [shape] = swarmdata.rays.payloads(replay, step);
    const [x, y] = targetOf(replay, 0, step);
    const angle = replay.has("goal_angle") ? replay.value("goal_angle", 0) : shape.angle;
    const goal = { ...shape, x, y, angle };
    const { payloadEdge } = pen.colors;
    const radius = pen.world.target_radius ?? 0;
    const near = Math.hypot(shape.x - x, shape.y - y) <= radius;
    outline(pen, goal, { fill: payloadEdge, alpha: 0.1 });
    outline(pen, goal, { stroke: payloadEdge, width: 0.024, dash: [0.06, 0.07] });
    pen.disc(x, y, radius, { fill: payloadEdge, alpha: near ? 0.5 : 0.25 });
  }

  function payloads(pen, replay, step) {
    const { payload: fill, payloadEdge } = pen.colors;
    const arrow = [[-0.6, -0.06], [0.35, -0.06], [0.35, -0.24], [0.85, 0], [0.35, 0.24], [0.35, 0.06], [-0.6, 0.06]];
    for (const shape of swarmdata.rays.payloads(replay, step)) {
      outline(pen, shape, { fill, stroke: payloadEdge, width: 0.03 });
      const corners = arrow.map(([a, l]) => [a * 0.6 * shape.a, l * 0.6 * shape.a]);
      pen.turned(corners, shape.x, shape.y, shape.angle, { fill: payloadEdge });
    }
  }

  const painters = { ring: goals, slot: slots, pose: payloadGoal };
  const targets = (pen, replay, step) => painters[pen.world.mark](pen, replay, step);

  return { floor, obstacles, targets, payloads };
})();
