// The index: cards are sorted and filtered by their attributes; the filters are kept in the address.
"use strict";
(() => {
  const form = document.getElementById("filters");
  const list = document.getElementById("cards");
  const cards = [...list.children];
  const fields = ["search", "task", "tier", "team", "size", "kind", "sort", "replays"];

  const valueOf = (name) => {
    const field = form.elements[name];
    return field.type === "checkbox" ? (field.checked ? "yes" : "") : field.value;
  };

  function accepts(card) {
    const { dataset } = card;
    const words = valueOf("search").toLowerCase().split(/\s+/).filter(Boolean);
    const text = `${dataset.name} ${dataset.task} ${dataset.tier} ${dataset.kind}`.toLowerCase();
    if (!words.every((word) => text.includes(word))) return false;
    return ["task", "tier", "team", "size", "kind", "replays"].every((name) => {
      const wanted = valueOf(name);
      return !wanted || dataset[name] === wanted;
    });
  }

  // All figures are sorted from high to low, so unknown ones come last.
  function comparison() {
    const name = valueOf("sort");
    if (name === "name") return (a, b) => a.dataset.name.localeCompare(b.dataset.name, "en");
    const figure = (card) => (card.dataset[name] === "" ? -1e9 : Number(card.dataset[name]));
    return (a, b) => figure(b) - figure(a) || a.dataset.name.localeCompare(b.dataset.name, "en");
  }

  function update() {
    const kept = cards.filter(accepts).sort(comparison());
    list.replaceChildren(...kept);
    const word = cards.length === 1 ? "dataset" : "datasets";
    document.getElementById("shown").textContent =
      kept.length === cards.length ? `${cards.length} ${word}` : `${kept.length} of ${cards.length} ${word}`;
  }

  // A choice is a step of the history; typing changes the present one.
  function remember(isStep) {
    const words = new URLSearchParams(fields.map((name) => [name, valueOf(name)]).filter(([, value]) => value));
    if (isStep) history.pushState(null, "", `#${words}`);
    else history.replaceState(null, "", `#${words}`);
  }

  function restore() {
    for (const name of fields) {
      const field = form.elements[name];
      if (field.type === "checkbox") field.checked = field.defaultChecked;
      else if (field.options) field.value = ([...field.options].find((option) => option.defaultSelected) || field.options[0]).value;
      else field.value = field.defaultValue;
    }
    for (const [name, value] of new URLSearchParams(location.hash.slice(1))) {
      const field = fields.includes(name) && form.elements[name];
      if (field && field.type === "checkbox") field.checked = value === "yes";
      else if (field) field.value = value;
    }
  }

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => {
    update();
    remember(true);
  }));
  form.addEventListener("input", (event) => {
    update();
    remember(event.target.type !== "search" && event.target.type !== "text");
  });
  const show = () => {
    restore();
    update();
  };
  addEventListener("popstate", show); // Back, Forward, and links to other filters
  show();
  document.body.dataset.ready = "yes";
})();
