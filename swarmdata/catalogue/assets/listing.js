// The index: cards, or a table of the same datasets, sorted and filtered by their attributes.
"use strict";
(() => {
  const FEW = 24; // cards at first
  const list = document.getElementById("cards");
  const cards = [...list.children];
  const more = document.querySelector(".more");
  const table = document.getElementById("table");
  const rows = new Map([...table.querySelectorAll("tbody tr")].map((row) => [row.dataset.name, row]));
  const facets = ["task", "tier", "team", "need", "messages", "costs", "kind", "replays"];
  let limit = FEW;

  function accepts(card, values) {
    const { dataset } = card;
    const words = values.search.toLowerCase().split(/\s+/).filter(Boolean);
    const text = `${dataset.name} ${dataset.task} ${dataset.tier} ${dataset.kind}`.toLowerCase();
    if (!words.every((word) => text.includes(word))) return false;
    return facets.every((name) => !values[name] || dataset[name] === values[name]);
  }

  // All figures are sorted from high to low, so unknown ones come last.
  function comparison(name) {
    if (name === "name") return (a, b) => a.dataset.name.localeCompare(b.dataset.name, "en");
    const figure = (card) => (card.dataset[name] === "" ? -1e9 : Number(card.dataset[name]));
    return (a, b) => figure(b) - figure(a) || a.dataset.name.localeCompare(b.dataset.name, "en");
  }

  let kept = [];
  function render() {
    list.replaceChildren(...kept.slice(0, limit));
    more.hidden = list.hidden || kept.length <= limit;
    more.textContent = `Show all ${kept.length}`;
  }

  function show(found, values) {
    const isTable = values.view === "table";
    list.hidden = isTable;
    table.hidden = !isTable || !found.length;
    kept = found.sort(comparison(values.sort));
    limit = FEW;
    const names = new Set(kept.map((card) => card.dataset.name));
    for (const [name, row] of rows) row.hidden = !names.has(name);
    render();
  }

  more.addEventListener("click", () => {
    limit = Infinity;
    render();
  });
  swarmdata.startFilters({ items: () => cards, accepts, show });
})();
