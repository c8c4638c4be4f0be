// Images of a recorded episode: what each agent observed, at the states that the catalogue holds.
"use strict";
swarmdata.Pictures = class {
  constructor(place, series) {
    this.place = place;
    this.series = series;
    const [height, width] = series.image;
    this.canvases = series.names.map((name) =>
      swarmdata.el("canvas", { width, height, role: "img", "aria-label": `image that ${name} observed` }),
    );
    const figure = (canvas, k) => swarmdata.el("figure", {}, swarmdata.el("figcaption", {}, series.names[k]), canvas);
    place.replaceChildren(...this.canvases.map(figure));
  }

  // `states` are those that have an image; null: this episode has none.
  show(states, values) {
    this.place.hidden = states === null;
    this.states = states;
    this.values = values;
  }

  at(step) {
    if (!this.states) return;
    let row = 0;
    while (row + 1 < this.states.length && this.states[row + 1] <= step) row++;
    const rows = this.states.length;
    this.canvases.forEach((canvas, i) => {
      const context = canvas.getContext("2d");
      const image = context.createImageData(canvas.width, canvas.height);
      const n = canvas.width * canvas.height;
      for (let k = 0; k < n; k++) {
        for (let c = 0; c < 3; c++) image.data[4 * k + c] = this.values[((i * n + k) * 3 + c) * rows + row];
        image.data[4 * k + 3] = 255;
      }
      context.putImageData(image, 0, 0);
    });
  }
};
