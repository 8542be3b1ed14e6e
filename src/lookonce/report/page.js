"use strict";
// Sorting, the choice of one sequence, and what lies under the pointer; the page can be read without any of it.

for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  for (const head of table.tHead.rows[0].cells) {
    const button = document.createElement("button");
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const isRising = head.getAttribute("aria-sort") === "descending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", isRising ? "ascending" : "descending");
      const value = (row) => row.cells[head.cellIndex].dataset.v ?? row.cells[head.cellIndex].textContent;
      const compare = (a, b) => a - b || String(a).localeCompare(String(b), undefined, { numeric: true });
      const rows = [...body.rows].sort((a, b) => compare(value(a), value(b)));
      body.append(...(isRising ? rows : rows.reverse()));
    });
  }
}

const choice = document.getElementById("only");
if (choice) {
  choice.closest("label").hidden = false;
  choice.addEventListener("change", () => {
    for (const one of document.querySelectorAll("[data-sequence]")) {
      one.hidden = choice.value !== "" && one.dataset.sequence !== choice.value;
    }
    const shown = document.querySelector(`article[data-sequence="${CSS.escape(choice.value)}"]`);
    if (choice.value !== "" && shown) shown.scrollIntoView();
  });
}

for (const chart of document.querySelectorAll(".tl")) {
  const readout = chart.querySelector(".readout");
  const usual = readout.textContent;
  chart.addEventListener("pointerover", (event) => {
    const group = event.target.closest("g[data-i]");
    for (const one of chart.querySelectorAll("g.hot")) one.classList.remove("hot");
    chart.querySelector(".bars").classList.toggle("focus", group !== null);
    readout.textContent = group ? group.querySelector("title").textContent : usual;
    if (group) for (const one of chart.querySelectorAll(`g[data-i="${group.dataset.i}"]`)) one.classList.add("hot");
  });
  chart.addEventListener("pointerleave", () => {
    for (const one of chart.querySelectorAll("g.hot")) one.classList.remove("hot");
    chart.querySelector(".bars").classList.remove("focus");
    readout.textContent = usual;
  });
}
