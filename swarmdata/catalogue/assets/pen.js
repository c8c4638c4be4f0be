// Draws shapes in metres on a canvas: x to the right, y up, the origin in the middle of the arena.
"use strict";
swarmdata.Pen = class {
  constructor(canvas, world, colors) {
    this.context = canvas.getContext("2d");
    this.colors = colors;
    this.margin = 0.1; // m of wall around the arena
    this.scale = canvas.width / (world.width + 2 * this.margin); // pixels in a metre
    this.world = world;
    this.context.setTransform(1, 0, 0, 1, 0, 0);
    this.context.clearRect(0, 0, canvas.width, canvas.height);
    this.context.lineJoin = "round";
  }

  at(x, y) {
    const { world, margin, scale } = this;
    return [(x + world.width / 2 + margin) * scale, (world.height / 2 + margin - y) * scale];
  }

  ink(style) {
    const { context, scale } = this;
    context.globalAlpha = style.alpha === undefined ? 1 : style.alpha;
    context.setLineDash((style.dash || []).map((length) => length * scale));
    if (style.fill) {
      context.fillStyle = style.fill;
      context.fill();
    }
    if (style.stroke) {
      context.strokeStyle = style.stroke;
      context.lineCap = style.cap || "round";
      context.lineWidth = Math.max(1, (style.width || 0.015) * scale);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  disc(x, y, radius, style) {
    const [px, py] = this.at(x, y);
    this.context.beginPath();
    this.context.arc(px, py, radius * this.scale, 0, 2 * Math.PI);
    this.ink(style);
  }

  path(points, style, closed = false) {
    this.context.beginPath();
    points.forEach(([x, y], k) => this.context[k ? "lineTo" : "moveTo"](...this.at(x, y)));
    if (closed) this.context.closePath();
    this.ink(style);
  }

  // A polygon given as (ahead, left) around a place.
  turned(corners, x, y, angle, style) {
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const points = corners.map(([a, l]) => [x + a * cos - l * sin, y + a * sin + l * cos]);
    this.path(points, style, true);
  }

  rectangle(x, y, angle, a, b, style) {
    const corners = [[-a, -b], [a, -b], [a, b], [-a, b]];
    this.turned(corners, x, y, angle, style);
  }

  label(text, x, y, size, color) {
    const { context } = this;
    context.font = `600 ${size * this.scale}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = color;
    context.fillText(text, ...this.at(x, y));
  }
};
