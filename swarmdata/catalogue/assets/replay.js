// A recorded episode of a world as functions of time: positions are interpolated between steps.
"use strict";
swarmdata.Replay = class {
  constructor(table, position, arrays) {
    this.world = table.world;
    this.position = position;
    this.rows = arrays.rows;
    this.length = arrays.rows - 1;
    this.groups = {};
    for (const part of ["moving", "fixed"]) {
      let column = 0;
      for (const [name, count, unit] of table[part]) {
        const rows = part === "moving" ? this.rows : 1;
        this.groups[name] = { values: arrays[part], first: column, count, unit, rows };
        column += count;
      }
    }
    this.duration = this.length * this.world.dt;
    this.returns = this.sumRewards();
    this.events = this.findEvents(table.episodes.ends[table.episodes.end[position]]);
  }

  has(name) {
    return name in this.groups;
  }

  count(name) {
    return this.groups[name].count;
  }

  // The code of a column in a step.
  code(name, i, step) {
    const group = this.groups[name];
    return group.values[(group.first + i) * group.rows + Math.min(step, group.rows - 1)];
  }

  value(name, i, step = 0) {
    return this.code(name, i, step) * this.groups[name].unit;
  }

  // A value between steps; differences of codes wrap, so that angles turn the short way.
  between(name, i, step) {
    const low = Math.min(Math.floor(step), this.length);
    const high = Math.min(low + 1, this.length);
    const start = this.code(name, i, low);
    const change = ((this.code(name, i, high) - start) << 16) >> 16;
    return (start + change * (step - low)) * this.groups[name].unit;
  }

  place(i, step) {
    return [this.between("x", i, step), this.between("y", i, step)];
  }

  // Direction in which a robot points: its heading, else that of its motion; null at rest.
  heading(i, step) {
    if (this.world.robots[i].turns) return this.between("angle", i, step);
    const at = Math.min(Math.max(1, Math.ceil(step)), this.length);
    const dx = this.value("x", i, at) - this.value("x", i, at - 1);
    const dy = this.value("y", i, at) - this.value("y", i, at - 1);
    return Math.hypot(dx, dy) < 0.02 * this.world.dt ? null : Math.atan2(dy, dx);
  }

  sumRewards() {
    const sums = new Float64Array(this.rows);
    for (let t = 1; t < this.rows; t++) sums[t] = sums[t - 1] + this.value("reward", 0, t);
    return sums;
  }

  // What a robot's event code of a step says.
  contact(i, step) {
    const code = this.code("event", i, step);
    return {
      touches: (code & 3) !== 0,
      robotOnsets: (code >> 2) & 7,
      obstacleOnsets: (code >> 5) & 7,
      moments: this.world.moments.map((_, k) => (code & (256 << k)) !== 0),
    };
  }

  findEvents(end) {
    const found = [];
    const names = this.world.names;
    const kinds = [
      [(event) => event.robotOnsets, "robot", "touch each other", "touch each other"],
      [(event) => event.obstacleOnsets, "obstacle", "touches an obstacle or wall", "touch an obstacle or wall"],
      ...this.world.moments.map(([kind, one, several], k) => [(event) => event.moments[k], kind, one, several]),
    ];
    for (let t = 1; t < this.rows; t++) {
      const events = names.map((_, i) => this.contact(i, t));
      for (const [happens, kind, one, several] of kinds) {
        const who = names.filter((_, i) => happens(events[i]));
        if (who.length) found.push({ step: t, kind, text: `${who.join(" and ")} ${who.length > 1 ? several : one}` });
      }
    }
    const kind = end === "success" ? "success" : "end";
    found.push({ step: this.length, kind, text: swarmdata.outcomes[end] });
    return found;
  }

  // Pairs [receiver, sender] of a kind of link in a step.
  links(name, step) {
    if (!this.has(name)) return [];
    const n = this.world.robots.length;
    const words = this.count(name) / n;
    const found = [];
    for (let receiver = 0; receiver < n; receiver++) {
      for (let word = 0; word < words; word++) {
        const bits = this.code(name, receiver * words + word, step);
        for (let bit = 0; bit < 15; bit++) if (bits & (1 << bit)) found.push([receiver, word * 15 + bit]);
      }
    }
    return found;
  }

  // Obstacles as { kind, x, y, angle, a, b, t }, lengths in metres.
  obstacles() {
    const found = [];
    for (let k = 0; k < this.count("obstacle_kind"); k++) {
      const [x, y, a, b, t] = [0, 1, 2, 3, 4].map((c) => this.value("obstacle_size", 5 * k + c));
      found.push({ kind: this.code("obstacle_kind", k, 0), x, y, a, b, t, angle: this.value("obstacle_angle", k) });
    }
    return found;
  }
};
