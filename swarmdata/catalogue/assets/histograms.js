// Histograms of the episodes; a range that is dragged or typed filters the table.
"use strict";
swarmdata.Histogram = class {
  constructor(name, label, values, onChange) {
    this.values = values;
    this.onChange = onChange;
    const { el, svg } = swarmdata;
    this.plot = svg("svg", { viewBox: "0 0 200 60", preserveAspectRatio: "none", "aria-hidden": "true" });
    const field = (which, end) =>
      el("input", { type: "number", step: "any", "aria-label": `${label}, ${which}`, placeholder: end });
    this.finite = values.filter(Number.isFinite);
    const ends = [Math.min(...this.finite), Math.max(...this.finite)].map((end) => (Number.isFinite(end) ? String(Number(end.toPrecision(3))) : "–"));
    this.fields = [field("from", ends[0]), field("to", ends[1])];
    for (const one of this.fields) one.addEventListener("input", () => this.changed());
    const range = el("div", { class: "ends" }, this.fields[0], "to", this.fields[1]);
    this.node = el("fieldset", { class: "histogram", "data-name": name }, el("legend", {}, label), this.plot, range);
    this.bins = this.makeBins();
    this.dragFrom = null;
    this.plot.addEventListener("pointerdown", (event) => this.drag(event, true));
    this.plot.addEventListener("pointermove", (event) => this.drag(event, false));
    this.plot.addEventListener("pointerup", () => this.drop());
  }

  // Bins with round ends: whole numbers get bins of whole width.
  makeBins() {
    const [low, high] = [Math.min(...this.finite), Math.max(...this.finite)];
    const whole = this.finite.every(Number.isInteger);
    if (!this.finite.length) return { low: 0, width: 1, n: 1, whole };
    if (low === high) return { low: low - 4, width: 1, n: 9, whole };
    const n = whole ? Math.min(24, high - low + 1) : 24;
    const width = whole ? Math.ceil((high - low + 1) / n) : (high - low) / n || 1;
    return { low, width, n: whole ? Math.ceil((high - low + 1) / width) : n, whole };
  }

  binOf(value) {
    const { low, width, n } = this.bins;
    return Math.min(n - 1, Math.floor((value - low) / width));
  }

  range() {
    const [from, to] = this.fields.map((one) => (one.value === "" ? null : Number(one.value)));
    return [from === null ? -Infinity : from, to === null ? Infinity : to];
  }

  accepts(k) {
    const [from, to] = this.range();
    if (from === -Infinity && to === Infinity) return true; // also what is not finite
    return this.values[k] >= from && this.values[k] <= to;
  }

  clear() {
    for (const one of this.fields) one.value = "";
  }

  changed() {
    this.onChange();
  }

  // Bars of all episodes, and in front of them those that the filters leave.
  draw(kept) {
    const { n } = this.bins;
    const [all, some] = [new Array(n).fill(0), new Array(n).fill(0)];
    this.values.forEach((value, k) => {
      if (!Number.isFinite(value)) return;
      all[this.binOf(value)] += 1;
      if (kept.has(k)) some[this.binOf(value)] += 1;
    });
    const most = Math.max(1, ...all);
    const bar = (count, k, name) =>
      swarmdata.svg("rect", {
        x: (k * 200) / n + 0.5, width: 200 / n - 1, class: name,
        y: 60 - (58 * count) / most, height: (58 * count) / most,
      });
    this.plot.replaceChildren(...all.map((c, k) => bar(c, k, "all")), ...some.map((c, k) => bar(c, k, "some")));
  }

  drag(event, starts) {
    if (!starts && this.dragFrom === null) return;
    const box = this.plot.getBoundingClientRect();
    const { low, width, n, whole } = this.bins;
    const share = Math.min(Math.max(0, (event.clientX - box.left) / box.width), 0.9999);
    const bin = Math.floor(share * n);
    if (starts) {
      this.dragFrom = bin;
      this.plot.setPointerCapture(event.pointerId);
    }
    const [first, last] = [Math.min(bin, this.dragFrom), Math.max(bin, this.dragFrom)];
    const end = low + (last + 1) * width - (whole ? 1 : 0);
    this.fields[0].value = Number((low + first * width).toPrecision(6));
    this.fields[1].value = Number((whole ? end : end + 1e-5 * width).toPrecision(6));
    this.changed();
  }

  drop() {
    this.dragFrom = null;
  }
};
