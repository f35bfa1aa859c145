// Switches scenes and strategies, and shows the values of a figure under the pointer. Without it the page is whole.
"use strict";
(() => {
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const press = (button, on) => button.setAttribute("aria-pressed", on);
  const pressed = (button) => button.getAttribute("aria-pressed") === "true";
  const scenes = all("[data-show]"), toggles = all("[data-toggle]");

  // Switching.
  const show = (name) => {
    scenes.forEach((b) => press(b, b.dataset.show === name));
    all("[data-scene]").forEach((e) => { e.hidden = name !== "all" && e.dataset.scene !== name; });
  };
  const toggle = (button, on) => {
    press(button, on);
    all("[data-strategy]").forEach((e) => {
      if (e.dataset.strategy === button.dataset.toggle) e.toggleAttribute("data-off", !on);
    });
  };
  // Bars that are on stand side by side, as the page's maker has laid them out at first.
  const layOut = () => all("svg.bars").forEach((chart) => {
    const [left, bar, gap, letter, margin] = chart.dataset.layout.split(",").map(Number);
    let x = left + gap / 2;
    all("[data-group]", chart).forEach((group) => {
      const on = all(".bar", group).filter((b) => !b.hasAttribute("data-off"));
      on.forEach((b, i) => b.setAttribute("transform", `translate(${x + i * bar} 0)`));
      group.querySelector("text").setAttribute("x", x);
      x += Math.max(on.length * bar, letter * group.dataset.group.length) + gap;
    });
    const { width, height } = chart.viewBox.baseVal, needed = Math.max(x + margin, width);
    chart.setAttribute("viewBox", `0 0 ${needed} ${height}`);
    chart.setAttribute("width", needed);
    all(".grid, .axis", chart).forEach((e) => e.setAttribute("x2", needed - margin));
  });
  const remember = () => {
    layOut();
    const scene = scenes.find(pressed), on = toggles.filter(pressed).map((b) => b.dataset.toggle);
    const state = new URLSearchParams();
    if (scene && scene.dataset.show !== "all") state.set("scene", scene.dataset.show);
    state.set("strategies", on.join(","));
    history.replaceState(null, "", "#" + state);
  };
  scenes.forEach((b) => b.addEventListener("click", () => { show(b.dataset.show); remember(); }));
  toggles.forEach((b) => b.addEventListener("click", () => { toggle(b, !pressed(b)); remember(); }));
  all("[data-only]").forEach((b) => b.addEventListener("click", () => {
    const names = b.dataset.only.split(",");
    toggles.forEach((t) => toggle(t, names[0] === "*" || names.includes(t.dataset.toggle)));
    remember();
  }));

  // Values: the lines' own points, in the order of their paths.
  const svg = (name, attributes, text) => {
    const e = document.createElementNS("http://www.w3.org/2000/svg", name);
    Object.entries(attributes).forEach(([k, v]) => e.setAttribute(k, v));
    if (text !== undefined) e.textContent = text;
    return e;
  };
  const points = (path) => {
    if (!path.points) {
      const [x, y] = [path.dataset.x.split(";"), path.dataset.y.split(";")];
      const places = path.getAttribute("d").split(/[MLh]/).slice(1).map((p) => p.split(" ").map(Number));
      path.points = x.map((at, i) => ({ at, value: y[i], place: places[i] })).filter((p) => p.place);
    }
    return path.points;
  };
  const read = (panel, at) => {
    all(".readout", panel).forEach((e) => e.remove());
    const lines = all("path[data-x]", panel).filter((p) => !p.hasAttribute("data-off") && points(p).length);
    if (at === null || !lines.length) return;
    const distance = (p) => Math.abs(p.place[0] - at);
    const found = lines.map((path) => ({
      path, point: points(path).reduce((a, b) => (distance(b) < distance(a) ? b : a)),
    }));
    const nearest = Math.min(...found.map((f) => distance(f.point)));
    const main = found.find((f) => distance(f.point) === nearest).point;
    const [left, top, right, bottom] = panel.dataset.area.split(",").map(Number);
    // A line that was measured on fewer frames is read only where it was.
    const shown = found.filter((f) => Math.abs(f.point.place[0] - main.place[0]) < 2)
      .sort((a, b) => a.point.place[1] - b.point.place[1]);
    const g = svg("g", { class: "readout", "data-at": main.at });
    g.append(svg("line", { x1: main.place[0], x2: main.place[0], y1: top, y2: bottom }));
    shown.forEach(({ path, point }) => g.append(svg("circle", {
      cx: point.place[0], cy: point.place[1], r: 3, class: path.classList[1] })));
    const width = 12 + 6.6 * Math.max(...shown.map((f) => (f.path.dataset.strategy + f.point.value).length + 3));
    const x = main.place[0] + width + 12 > right ? Math.max(main.place[0] - width - 8, left) : main.place[0] + 8;
    g.append(svg("rect", { x, y: top + 2, width, height: 22 + 15 * shown.length, rx: 3 }));
    const label = panel.querySelector(".label + .title ~ .label") || panel.querySelectorAll(".label")[1];
    g.append(svg("text", { x: x + 7, y: top + 17, class: "head" }, `${label.textContent.trim()} ${main.at}`));
    shown.forEach(({ path, point }, i) => {
      const y = top + 33 + 15 * i;
      g.append(svg("text", { x: x + 7, y, class: path.classList[1] }, path.dataset.strategy));
      g.append(svg("text", { x: x + width - 7, y, "text-anchor": "end" }, point.value));
    });
    panel.append(g);
  };
  all("svg.panel").forEach((panel) => {
    const width = panel.viewBox.baseVal.width;
    let at = null;
    const move = (e) => {
      const box = panel.getBoundingClientRect();
      at = ((e.clientX - box.left) / box.width) * width;
      read(panel, at);
    };
    panel.setAttribute("tabindex", "0");
    panel.addEventListener("pointermove", move);
    panel.addEventListener("pointerdown", move);
    // A finger leaves as soon as it is lifted.
    panel.addEventListener("pointerleave", (e) => { if (e.pointerType !== "touch") read(panel, null); });
    panel.addEventListener("blur", () => read(panel, null));
    panel.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
      if (!step) return;
      e.preventDefault();
      const path = all("path[data-x]", panel).find((p) => !p.hasAttribute("data-off") && points(p).length);
      if (!path) return;
      const places = points(path).map((p) => p.place[0]);
      const now = at === null ? -1 : places.reduce((a, x, i) => (Math.abs(x - at) < Math.abs(places[a] - at) ? i : a), 0);
      at = places[Math.min(Math.max(now + step, 0), places.length - 1)];
      read(panel, at);
    });
  });

  // Bars and scattered settings say their own values, in a line below; one at a time has the keyboard.
  const choosers = all("svg.bars, svg.scatter").map((chart) => {
    const line = document.createElement("p");
    line.className = "values";
    line.setAttribute("role", "status");
    chart.closest("figure").querySelector("figcaption").before(line);
    let at = null;
    const marks = () => all("title", chart).map((t) => t.parentNode).filter((m) => !m.hasAttribute("data-off"));
    const choose = (mark) => {
      at = mark ?? null;
      line.textContent = at ? at.querySelector("title").textContent : "";
    };
    const away = (e, mark) => {
      const box = mark.getBoundingClientRect();
      return Math.hypot(Math.max(box.left - e.clientX, 0, e.clientX - box.right),
        Math.max(box.top - e.clientY, 0, e.clientY - box.bottom));
    };
    chart.setAttribute("tabindex", "0");
    chart.addEventListener("pointerdown", (e) => {
      choose(marks().map((m) => [away(e, m), m]).sort((a, b) => a[0] - b[0])[0]?.[1]);
    });
    chart.addEventListener("focus", () => { if (!at) choose(marks()[0]); });
    chart.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
      if (!step) return;
      e.preventDefault();
      const list = marks();
      choose(list[Math.min(Math.max(list.indexOf(at) + step, 0), list.length - 1)]);
    });
    return (part) => choose(marks()[Math.round(part * (marks().length - 1))]);
  });

  // What the address says, by the same buttons that a reader presses.
  const state = new URLSearchParams(location.hash.slice(1));
  const scene = scenes.find((b) => b.dataset.show === state.get("scene"));
  if (scene) scene.click();
  if (state.has("strategies")) {
    const names = state.get("strategies").split(",");
    toggles.filter((b) => pressed(b) !== names.includes(b.dataset.toggle)).forEach((b) => b.click());
  }
  // `read=0.5` points at the middle of every figure.
  if (state.has("read")) {
    const part = Number(state.get("read"));
    all("svg.panel").forEach((panel) => read(panel, panel.viewBox.baseVal.width * part));
    choosers.forEach((choose) => choose(part));
  }
  document.documentElement.dataset.script = "ran";
})();
