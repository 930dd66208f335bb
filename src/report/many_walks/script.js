// Sorts the walks by a column. The page is complete without it.
"use strict";
(() => {
  const words = new Intl.Collator(undefined, { numeric: true }).compare;
  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    const sort = (column) => {
      const descending = heads[column].ariaSort === "ascending";
      // A figure that was not measured is larger than all others.
      const key = (row) => {
        const { dataset, textContent } = row.cells[column];
        return dataset.value === undefined ? textContent : dataset.value === "" ? Infinity : Number(dataset.value);
      };
      const compare = (a, b) => (typeof a === "number" ? Math.sign(a - b) || 0 : words(a, b));
      const rows = [...body.rows].sort((a, b) => compare(key(a), key(b)));
      body.append(...(descending ? rows.reverse() : rows));
      for (const head of heads) head.removeAttribute("aria-sort");
      heads[column].setAttribute("aria-sort", descending ? "descending" : "ascending");
    };
    heads.forEach((head, column) => {
      head.tabIndex = 0;
      head.title = "sort by this column";
      head.addEventListener("click", () => sort(column));
      head.addEventListener("keydown", (event) => {
        if (event.key === "Enter" || event.key === " ") {
          event.preventDefault();
          sort(column);
        }
      });
    });
  }
})();
