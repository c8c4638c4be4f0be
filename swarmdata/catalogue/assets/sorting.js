// Tables that are sorted by a click on their heads.
"use strict";
(() => {
  const { el } = swarmdata;

  function sortBy(table, column, head) {
    // numbers begin with the best: the highest, but for what is better low
    const falls = head.classList.contains("n") && !("low" in head.dataset);
    const sorted = head.getAttribute("aria-sort");
    const rising = ["ascending", "descending"].includes(sorted) ? sorted === "descending" : !falls;
    const value = (row) => row.cells[column].dataset.value || row.cells[column].textContent;
    const number = (text) => (text === "" || Number.isNaN(Number(text)) ? null : Number(text));
    const rows = [...table.tBodies[0].rows].sort((a, b) => {
      const [x, y] = [value(a), value(b)];
      const [m, n] = [number(x), number(y)];
      const order = m !== null && n !== null ? m - n : x.localeCompare(y, "en");
      return rising ? order : -order;
    });
    table.tBodies[0].append(...rows);
    for (const each of table.tHead.rows[0].cells) each.setAttribute("aria-sort", "none");
    head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      if (head.dataset.fixed) return; // a drawing of the column beside it
      const button = el("button", { type: "button" }, head.textContent);
      button.addEventListener("click", () => sortBy(table, column, head));
      head.replaceChildren(button);
    });
  }
})();
