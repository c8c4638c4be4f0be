// The table of episodes: sorted by a column, filtered by the histograms and choices beside it.
"use strict";
swarmdata.EpisodeTable = class {
  constructor(root, table, onOpen) {
    this.root = root;
    this.onOpen = onOpen;
    const { episodes } = table;
    this.body = root.querySelector("tbody");
    this.count = root.querySelector(".count");
    this.more = root.querySelector(".more");
    this.limit = 200;
    this.nReplays = table.replays || 0; // of a result, whose first rows have them
    this.sort = { name: this.nReplays ? "position" : "index", direction: 1 };
    this.columns = [...root.querySelectorAll("th[data-column]")].map((head) => head.dataset.column);
    this.rows = episodes.index.map((index, k) => ({
      index, position: k,
      number: episodes.number ? episodes.number[k] : index,
      time: episodes.time ? episodes.time[k] : NaN,
      policy: episodes.policies[episodes.policy[k]],
      end: episodes.ends[episodes.end[k]],
      return: episodes.return[k],
      length: episodes.length[k],
      collisions: episodes.robot_collisions[k] + episodes.obstacle_collisions[k],
      split: episodes.splits[episodes.split[k]],
    }));
    this.addHistograms();
    this.addChoices(episodes);
    this.more.addEventListener("click", () => this.showMore());
    root.querySelector(".clear").addEventListener("click", () => this.clear());
    for (const button of root.querySelectorAll("thead button")) {
      button.addEventListener("click", () => this.sortBy(button.dataset.sort));
    }
    this.update();
  }

  addHistograms() {
    const place = this.root.querySelector(".histograms");
    const kinds = [["return", "Return"], ["length", "Length, steps"], ["time", "Time to goal, s"], ["collisions", "Collisions"]];
    const known = kinds.filter(([name]) => this.columns.includes(name));
    this.histograms = known.map(([name, label]) => {
      const values = this.rows.map((row) => row[name]);
      return new swarmdata.Histogram(name, label, values, () => this.update());
    });
    place.append(...this.histograms.map((each) => each.node), this.outcomes());
  }

  // The outcomes are few, so their histogram is made of buttons.
  outcomes() {
    const { el } = swarmdata;
    const ends = [...new Set(this.rows.map((row) => row.end))].sort();
    this.chosenEnds = new Set();
    const buttons = ends.map((end) => {
      const n = this.rows.filter((row) => row.end === end).length;
      const share = (100 * n) / this.rows.length;
      const bar = swarmdata.svg("svg", { viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" },
        swarmdata.svg("rect", { width: share, height: 6, class: "some" }));
      const button = el("button", { type: "button", "aria-pressed": "false", "data-end": end },
        el("span", {}, swarmdata.outcomes[end]), el("span", { class: "share" }, `${n} (${share.toFixed(0)} %)`), bar);
      button.addEventListener("click", () => {
        if (!this.chosenEnds.delete(end)) this.chosenEnds.add(end);
        button.setAttribute("aria-pressed", String(this.chosenEnds.has(end)));
        this.update();
      });
      return button;
    });
    return el("fieldset", { class: "histogram outcomes" }, el("legend", {}, "Outcome"), ...buttons);
  }

  addChoices(episodes) {
    this.choices = [...this.root.querySelectorAll(".choices select")].map((select) => {
      const { name } = select;
      const values = name === "policy" ? episodes.policies : episodes.splits;
      for (const value of values) select.append(swarmdata.el("option", { value }, value));
      select.addEventListener("change", () => this.update());
      return [name, select];
    });
  }

  clear() {
    for (const histogram of this.histograms) histogram.clear();
    for (const [, select] of this.choices) select.value = "";
    this.chosenEnds.clear();
    for (const button of this.root.querySelectorAll("[data-end]")) button.setAttribute("aria-pressed", "false");
    this.update();
  }

  accepts(row) {
    if (this.chosenEnds.size && !this.chosenEnds.has(row.end)) return false;
    if (this.choices.some(([name, select]) => select.value && row[name] !== select.value)) return false;
    return this.histograms.every((histogram) => histogram.accepts(row.position));
  }

  sortBy(name) {
    const same = this.sort.name === name;
    this.sort = { name, direction: same ? -this.sort.direction : 1 };
    this.update();
  }

  update() {
    const { name, direction } = this.sort;
    const value = (row) => (Number.isNaN(row[name]) ? Infinity : row[name]);
    const compare = (a, b) => (value(a) > value(b) ? direction : value(a) < value(b) ? -direction : 0);
    this.kept = this.rows.filter((row) => this.accepts(row)).sort(compare);
    const positions = new Set(this.kept.map((row) => row.position));
    for (const histogram of this.histograms) histogram.draw(positions);
    for (const head of this.root.querySelectorAll("th[data-column]")) {
      const sorted = head.dataset.column === name;
      head.setAttribute("aria-sort", sorted ? (direction > 0 ? "ascending" : "descending") : "none");
    }
    this.count.textContent = `${this.kept.length} of ${this.rows.length} episodes`;
    this.render();
  }

  render() {
    const shown = this.kept.slice(0, this.limit);
    this.body.replaceChildren(...shown.map((row) => this.renderRow(row)));
    this.more.hidden = this.kept.length <= this.limit;
    this.markCurrent();
  }

  renderRow(row) {
    const { el, number } = swarmdata;
    const mark = row.position < this.nReplays ? "▶ " : "";
    const open = el("button", { type: "button", "aria-label": `Show episode ${row.number}` }, mark + row.number);
    const cells = {
      index: el("td", {}, open),
      policy: el("td", {}, row.policy),
      end: el("td", {}, swarmdata.outcomes[row.end]),
      return: el("td", { class: "n" }, number(row.return, 2)),
      length: el("td", { class: "n" }, String(row.length)),
      time: el("td", { class: "n" }, Number.isFinite(row.time) ? number(row.time, 1) : "–"),
      collisions: el("td", { class: "n" }, String(row.collisions)),
      split: el("td", {}, row.split),
    };
    const node = el("tr", { "data-position": row.position }, ...this.columns.map((name) => cells[name]));
    node.addEventListener("click", () => this.onOpen(row.position));
    return node;
  }

  showMore() {
    this.limit += 400;
    this.render();
  }

  setCurrent(position) {
    this.current = position;
    this.markCurrent();
  }

  markCurrent() {
    for (const row of this.body.children) {
      if (Number(row.dataset.position) === this.current) row.setAttribute("aria-current", "true");
      else row.removeAttribute("aria-current");
    }
  }

  // The position after or before the current one in the order of the table.
  neighbor(offset) {
    const at = this.kept.findIndex((row) => row.position === this.current);
    const next = this.kept[at + offset];
    return next ? next.position : null;
  }
};
