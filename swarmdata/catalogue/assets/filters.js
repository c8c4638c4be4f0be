// The form that filters a page. Its choices are kept in the address, and where they leave nothing,
// buttons say what to drop.
//   items(values)           what can be shown under a choice of values, by name of field,
//   accepts(item, values)   whether it is shown,
//   show(kept, values)      shows it.
"use strict";
swarmdata.startFilters = ({ items, accepts, show }) => {
  const { el } = swarmdata;
  const form = document.getElementById("filters");
  const status = document.getElementById("shown");
  const widen = document.getElementById("widen");
  const fields = [...form.elements].filter((field) => field.name);

  const initial = (field) => {
    if (field.type === "checkbox") return "";
    if (!field.options) return field.defaultValue;
    return ([...field.options].find((option) => option.defaultSelected) || field.options[0]).value;
  };
  const valueOf = (field) => (field.type === "checkbox" ? (field.checked ? "yes" : "") : field.value);
  const values = () => Object.fromEntries(fields.map((field) => [field.name, valueOf(field)]));

  function set(field, value) {
    if (field.type === "checkbox") field.checked = value === "yes";
    else if (!field.options || [...field.options].some((option) => option.value === value)) field.value = value;
  }

  // The value of a field that leaves nothing out; null: it has none.
  function widest(field) {
    if (!field.options) return "";
    const all = [...field.options].find((option) => option.text === "all");
    return all ? all.value : null;
  }

  function update() {
    const chosen = values();
    const all = items(chosen);
    const kept = all.filter((item) => accepts(item, chosen));
    show(kept, chosen);
    const { things } = status.dataset;
    const word = all.length === 1 ? things.replace(/s$/, "") : things;
    status.textContent = kept.length === all.length ? `${all.length} ${word}` : `${kept.length} of ${all.length} ${word}`;
    widen.hidden = kept.length > 0;
    if (!kept.length) widen.replaceChildren(...waysOut(chosen, all));
  }

  function waysOut(chosen, all) {
    const ways = fields.flatMap((field) => {
      const wide = widest(field);
      if (wide === null || chosen[field.name] === wide) return [];
      const n = all.filter((item) => accepts(item, { ...chosen, [field.name]: wide })).length;
      if (!n) return [];
      const label = field.labels[0].firstChild.textContent.trim() || field.labels[0].textContent.trim();
      const drop = () => {
        set(field, wide);
        update();
        remember(true);
      };
      return [el("button", { type: "button", onclick: drop }, `Any ${label.toLowerCase()} (${n})`)];
    });
    const clear = el("button", { type: "button", onclick: () => form.reset() }, "Clear all filters");
    return [el("p", {}, `No ${status.dataset.things} match all of these filters. Widen them:`), ...ways, clear];
  }

  // A choice is a step of the history; typing changes the present one.
  function remember(isStep) {
    const chosen = fields.map((field) => [field, valueOf(field)]).filter(([field, value]) => value !== initial(field));
    const words = new URLSearchParams(chosen.map(([field, value]) => [field.name, value]));
    if (isStep) history.pushState(null, "", `#${words}`);
    else history.replaceState(null, "", `#${words}`);
  }

  function restore() {
    const wanted = swarmdata.address();
    for (const field of fields) {
      set(field, initial(field));
      if (wanted.has(field.name)) set(field, wanted.get(field.name));
    }
    update();
  }

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => {
    update();
    remember(true);
  }));
  form.addEventListener("input", (event) => {
    update();
    remember(!["search", "text"].includes(event.target.type));
  });
  swarmdata.onAddress(restore);
  restore();
  document.body.dataset.ready = "yes";
};
