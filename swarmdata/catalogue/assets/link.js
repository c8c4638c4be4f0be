// The address of a moment: #episode=7&t=6.4, and with another episode beside it &with=ID&other=3.
"use strict";
swarmdata.link = {
  read() {
    const found = swarmdata.address();
    const number = (name) => {
      const value = found.get(name);
      return value !== null && value !== "" && Number.isFinite(Number(value)) ? Number(value) : null;
    };
    return { episode: number("episode"), time: number("t"), key: found.get("with"), other: number("other") };
  },

  // Another episode is a step of the history, another moment is not.
  write({ episode, time, key, other }) {
    const words = new URLSearchParams({ episode });
    if (time > 0) words.set("t", String(Number(time.toFixed(2))));
    if (key) {
      words.set("with", key);
      words.set("other", other);
    }
    const before = this.read();
    const isStep = before.episode !== null && (before.episode !== episode || before.key !== (key || null));
    if (isStep) history.pushState(null, "", `#${words}`);
    else history.replaceState(null, "", `#${words}`);
  },
};
