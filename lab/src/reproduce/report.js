// Tables that sort, charts that point at the same strategy and frame, and parts that open when something in them is
// asked for. Without this script the page still says all it says.
"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];

// A click on a column's head sorts by it: by the first number of each cell, or as text.
for (const table of all("table")) {
  const body = table.tBodies[0], heads = all("thead th", table);
  const value = (row, column) => row.cells[column].textContent.trim().replace(/\u202f/g, "");
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.append(...head.childNodes);
    button.title = "Sort by this column";
    head.append(button);
    button.onclick = () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach(other => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const compare = (a, b) => {
        const [x, y] = [value(a, column), value(b, column)], [m, n] = [parseFloat(x), parseFloat(y)];
        // What is no number comes last.
        if (!head.classList.contains("n")) return up ? x.localeCompare(y) : y.localeCompare(x);
        return isNaN(m) || isNaN(n) ? isNaN(m) - isNaN(n) : up ? m - n : n - m;
      };
      body.append(...[...body.rows].sort(compare));
    };
  });
}

// A strategy under the pointer, or with the focus, stands out wherever it is shown. Figures name theirs in the legend.
const marks = all("[data-strategy]").map(element => [element, element.dataset.strategy]);
const charts = all("figure svg");
for (const svg of charts) {
  const names = new Map(all("rect + text", svg).map(text => [text.previousElementSibling.getAttribute("fill"), text]));
  for (const element of all("polyline, rect", svg)) {
    const text = names.get(element.getAttribute(element.tagName === "rect" ? "fill" : "stroke"));
    if (!text || text.textContent.includes(":")) continue;
    const name = text.textContent.trim();
    marks.push([element, name]);
    if (element.nextElementSibling === text) marks.push([text, name]);
  }
}
const pointed = new Map(marks);
const point = name => marks.forEach(([element, its]) => element.classList.toggle("dim", name !== undefined && its !== name));
const nameAt = target => pointed.get(target) ?? pointed.get(target.closest?.("[data-strategy]"));
for (const event of ["pointerover", "focusin"]) addEventListener(event, ({ target }) => point(nameAt(target)));
addEventListener("focusout", () => point());

// A line at the same frame in all charts over frames: their panels have the same size.
const PANEL = 520, over = charts.filter(svg => svg.closest("figure").dataset.x === "frame");
const lines = over.flatMap(svg => [0, 1].map(panel => {
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  line.setAttribute("class", "cursor");
  line.setAttribute("y1", 30);
  line.setAttribute("y2", 270);
  svg.append(line);
  return [line, panel];
}));
for (const svg of over) {
  svg.addEventListener("pointermove", event => {
    const { left, width } = svg.getBoundingClientRect();
    const x = (event.clientX - left) * svg.viewBox.baseVal.width / width;
    const inside = x < 2 * PANEL && x % PANEL > 70 && x % PANEL < PANEL - 16;
    for (const [line, panel] of lines) {
      line.setAttribute("x1", x % PANEL + panel * PANEL);
      line.setAttribute("x2", x % PANEL + panel * PANEL);
      line.classList.toggle("on", inside);
    }
  });
  svg.addEventListener("pointerleave", () => lines.forEach(([line]) => line.classList.remove("on")));
}

// A link into a part that is closed opens it; paper shows all.
const show = () => {
  const target = location.hash && document.getElementById(location.hash.slice(1));
  if (!target) return;
  for (let at = target; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
  target.scrollIntoView();
};
addEventListener("hashchange", show);
show();
let opened = [];
addEventListener("beforeprint", () => {
  opened = all("details:not([open])");
  opened.forEach(part => { part.open = true; });
});
addEventListener("afterprint", () => opened.forEach(part => { part.open = false; }));
