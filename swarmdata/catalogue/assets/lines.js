// Line plots of a recorded episode: one for each array and agent, with the present step marked.
"use strict";
swarmdata.LinePlots = class {
  constructor(place) {
    this.place = place;
    this.marks = [];
  }

  // `arrays` as of data.arrays; lines follow each other panel by panel, agent by agent.
  show(series, arrays) {
    this.series = series;
    this.arrays = arrays;
  }

  // Draws what is shown on axes that hold `all` plots, this one among them.
  draw(all) {
    const { el } = swarmdata;
    this.marks = [];
    let line = 0;
    const nodes = [];
    for (const [name, count, total] of this.series.panels) {
      const note = count < total ? ` (the first ${count} of ${total} columns)` : "";
      const plots = this.series.names.map((agent) => {
        const lines = Array.from({ length: count }, () => line++);
        return this.plot(agent, name, lines, all);
      });
      nodes.push(el("section", {}, el("h3", {}, name + note), el("div", { class: "plots" }, ...plots)));
    }
    this.place.replaceChildren(...nodes);
  }

  plot(agent, name, lines, all) {
    const { svg, el } = swarmdata;
    const { low, high, levels } = this.series;
    const [values, rows] = [this.arrays.moving, this.arrays.rows];
    const bottom = Math.min(...all.flatMap((each) => lines.map((line) => each.series.low[line])));
    const top = Math.max(...all.flatMap((each) => lines.map((line) => each.series.high[line])));
    const last = Math.max(1, ...all.map((each) => each.arrays.rows - 1));
    const [width, height] = [400, 110];
    const x = (t) => (t / last) * width;
    const y = (value) => height - 3 - ((value - bottom) / (top - bottom || 1)) * (height - 6);
    const paths = lines.map((line, k) => {
      const span = (high[line] - low[line]) / levels;
      let words = "";
      for (let t = 0; t < rows; t++) {
        const code = values[line * rows + t];
        if (code < 0) continue;
        words += `${words && values[line * rows + t - 1] >= 0 ? "L" : "M"}${x(t).toFixed(1)} ${y(low[line] + code * span).toFixed(1)}`;
      }
      return svg("path", { d: words, class: `series-${k % 6}` });
    });
    const mark = svg("line", { y1: 0, y2: height, class: "now" });
    this.marks.push({ mark, x });
    const label = `${name} of ${agent}, from ${bottom} to ${top}`;
    const chart = svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img", "aria-label": label }, ...paths, mark);
    const range = el("span", { class: "range" }, `${Number(bottom.toPrecision(3))} to ${Number(top.toPrecision(3))}`);
    return el("figure", {}, el("figcaption", {}, agent, range), chart);
  }

  at(step) {
    for (const { mark, x } of this.marks) {
      mark.setAttribute("x1", x(step));
      mark.setAttribute("x2", x(step));
    }
  }
};
