// One canvas: shows a replay at a time, in the colors of the page's theme.
"use strict";
const [LEAST_HEIGHT, BELOW, CHOICE] = [200, 190, 45]; // px: of a canvas; below it, and more below two
swarmdata.View = class {
  constructor(figure) {
    this.figure = figure;
    this.canvas = figure.querySelector("canvas");
    this.caption = figure.querySelector(".outcome");
    this.replay = null;
    this.step = 0;
    this.options = {};
    new ResizeObserver(() => this.resize()).observe(figure);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  show(replay, describe) {
    this.replay = replay;
    this.describe = describe;
    this.resize();
  }

  resize() {
    if (!this.replay || !this.figure.clientWidth) return;
    const { world } = this.replay;
    const ratio = (world.height + 0.2) / (world.width + 0.2);
    const top = this.canvas.getBoundingClientRect().top + scrollY;
    const below = BELOW + (this.figure.closest(".two") ? CHOICE : 0);
    const room = Math.max(LEAST_HEIGHT, innerHeight - top - below); // so that it is played in sight
    const width = Math.min(this.figure.clientWidth, Math.min(640, room) / ratio);
    const density = Math.min(3, window.devicePixelRatio || 1);
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${width * ratio}px`;
    this.canvas.width = Math.round(width * density);
    this.canvas.height = Math.round(width * ratio * density);
    this.draw();
  }

  // A step beyond the end shows the last state.
  at(step, options) {
    this.step = Math.min(step, this.replay ? this.replay.length : 0);
    this.options = options;
    this.draw();
  }

  draw() {
    if (!this.replay || !this.canvas.width) return;
    const { replay, step, options } = this;
    const world = { ...replay.world, colors: this.robotColors() };
    const pen = new swarmdata.Pen(this.canvas, world, this.colors());
    swarmdata.marks.floor(pen);
    swarmdata.marks.obstacles(pen, replay);
    if (options.targets) swarmdata.marks.targets(pen, replay, step);
    if (options.trails) swarmdata.robots.trails(pen, replay, step);
    swarmdata.marks.payloads(pen, replay, step);
    if (options.sensors) swarmdata.signals.sensors(pen, replay, step);
    swarmdata.robots.bodies(pen, replay, step, options);
    if (options.radio && replay.world.radio) swarmdata.signals.messages(pen, replay, step);
  }

  // The colors of robots are dark or light whatever the theme: dark ones are lit on a dark floor.
  robotColors() {
    const lit = Number(getComputedStyle(this.figure).getPropertyValue("--lighting"));
    return this.replay.world.colors.map((color) => {
      const parts = [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16));
      const share = Math.max(0, lit - (0.3 * parts[0] + 0.6 * parts[1] + 0.1 * parts[2]) / 255);
      return `rgb(${parts.map((part) => Math.round(part + share * (255 - part))).join(" ")})`;
    });
  }

  colors() {
    const style = getComputedStyle(this.figure);
    const names = {
      wall: "wall", floor: "floor", grid: "grid", obstacle: "obstacle", neutral: "neutral",
      payload: "payload", payloadEdge: "payload-edge", contact: "contact", lost: "lost",
    };
    const read = ([key, name]) => [key, style.getPropertyValue(`--${name}`).trim()];
    return Object.fromEntries(Object.entries(names).map(read));
  }
};
