// Time: play, pause, speed, scrub and keyboard, for one view or two.
"use strict";
swarmdata.Player = class {
  constructor(root, onRest) {
    this.root = root;
    this.button = root.querySelector(".play");
    this.slider = root.querySelector("input[type=range]");
    this.clock = root.querySelector(".clock");
    this.speed = root.querySelector("select[name=speed]");
    this.onRest = onRest; // called when time rests somewhere new
    this.isInSteps = root.dataset.unit === "steps"; // else in seconds
    this.screens = []; // each { at(time), duration, dt }
    this.time = 0;
    this.frame = 0;
    this.button.addEventListener("click", () => this.toggle());
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    document.addEventListener("keydown", (event) => this.press(event));
  }

  get duration() {
    return Math.max(0, ...this.screens.map((screen) => screen.duration));
  }

  get dt() {
    return this.screens.length ? this.screens[0].dt : 1;
  }

  // Units of time for each second of the viewer's.
  get rate() {
    return Number(this.speed.value) * (this.isInSteps ? 10 : 1);
  }

  get isPlaying() {
    return this.frame !== 0;
  }

  setScreens(screens) {
    this.screens = screens;
    this.slider.max = this.duration;
    this.slider.step = this.dt;
    this.seek(Math.min(this.time, this.duration));
  }

  seek(time) {
    this.move(Math.min(Math.max(0, time), this.duration));
    if (!this.isPlaying) this.onRest();
  }

  move(time) {
    this.time = time;
    this.slider.value = time;
    const words = this.isInSteps
      ? `step ${Math.floor(time)} of ${this.duration}`
      : `${time.toFixed(1)} s of ${this.duration.toFixed(1)} s`;
    this.slider.setAttribute("aria-valuetext", words);
    this.clock.textContent = words;
    for (const screen of this.screens) screen.at(time);
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  play() {
    if (this.time >= this.duration) this.move(0);
    this.button.textContent = "❚❚";
    this.button.setAttribute("aria-label", "Pause");
    let last = null;
    const advance = (now) => {
      const passed = last === null ? 0 : Math.min(0.25, (now - last) / 1000);
      last = now;
      this.move(Math.min(this.duration, this.time + passed * this.rate));
      if (this.time >= this.duration) this.pause();
      else this.frame = requestAnimationFrame(advance);
    };
    this.frame = requestAnimationFrame(advance);
  }

  pause() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.button.textContent = "▶";
    this.button.setAttribute("aria-label", "Play");
    this.onRest();
  }

  // Whole steps from here; a time between two steps counts as the one before.
  step(count) {
    this.pause();
    this.seek((Math.floor(this.time / this.dt + 1e-6) + count) * this.dt);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target;
    const types = target.closest("select, textarea, input:not([type=range]):not([type=checkbox])");
    if (types) return;
    const presses = target.closest("button, summary, a, input[type=checkbox], [tabindex='0']");
    const actions = {
      " ": presses ? null : () => this.toggle(),
      k: () => this.toggle(),
      ArrowLeft: () => this.step(event.shiftKey ? -10 : -1),
      ArrowRight: () => this.step(event.shiftKey ? 10 : 1),
      Home: () => this.seek(0),
      End: () => this.seek(this.duration),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }
};
