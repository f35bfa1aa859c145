// Draws the page from the data in `run`: what summary.json has, and what report.rs adds. Then tables sort, charts point at
// the same strategy and frame, and parts open when something in them is asked for.
"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];

// A template of markup. Text in it is escaped, markup made by another template is not; false and null leave nothing.
class Markup { constructor(text) { this.text = text; } }
const escaped = text => String(text).replace(/[&<>"]/g, c => `&#${c.charCodeAt()};`);
const written = value => value instanceof Markup ? value.text : Array.isArray(value) ? value.map(written).join("")
  : value === false || value === null || value === undefined ? "" : escaped(value);
const html = (parts, ...values) => new Markup(parts.reduce((text, part, i) => text + written(values[i - 1]) + part));

const thousands = n => n.toFixed(0).replace(/\B(?=(\d{3})+$)/g, "\u202f");
// Three digits.
const number = x => x === null || !isFinite(x) ? "–" : Math.abs(x) >= 999.5 ? thousands(x)
  : x.toFixed(x === 0 || Math.abs(x) >= 99.95 ? 0 : Math.abs(x) >= 9.995 ? 1 : Math.abs(x) >= 0.9995 ? 2 : 3);
const capital = text => text.charAt(0).toUpperCase() + text.slice(1);
const plural = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;
const words = verdict => verdict.replaceAll("-", " ");

const { settings, machine, revision, claims, scenes } = run;
const main = scenes.filter(scene => !scene.supplement), supplements = scenes.filter(scene => scene.supplement);

// A table, sorted as it comes: `texts` columns of words, then numbers. A row has its strategy, if it is one's, and its cells.
const table = (heads, texts, rows) => html`<div class="scroll"><table>
  <thead><tr>${heads.map((head, i) => html`<th class="${i < texts ? "" : "n"}">${head}</th>`)}</tr></thead>
  <tbody>${rows.map(([strategy, ...cells]) => html`<tr ${strategy && html`data-strategy="${strategy}"`}>${cells.map((cell, i) =>
    i ? html`<td class="${i < texts ? "" : "n"}">${cell}</td>` : html`<th scope="row">${cell}</th>`)}</tr>`)}</tbody>
</table></div>`;
const folded = (title, content) => content && html`<details class="part"><summary><h2>${title}</h2></summary>${content}</details>`;

// The first screen: the answer, a mark for each claim, frame times, and a strip of pictures for each scene.
const tally = () => {
  const many = { "holds": "hold", "holds-in-part": "hold in part", "does-not-hold-here": "do not hold here", "not-run": "were not run" };
  const counts = Object.keys(many).map(verdict => {
    const n = claims.filter(claim => claim.verdict === verdict).length;
    return [n, n === 1 ? words(verdict).replace("not run", "was not run") : many[verdict]];
  });
  return `Of ${plural(claims.length, "claim")} ${counts.filter(([n]) => n).map(part => part.join(" ")).join(", ")}`;
};
const checks = html`<span class="${run.checks.differences ? "fails" : ""}">All strategies must see the same.
  ${capital(run.checked)}.${run.checks.first_difference && ` The first: ${run.checks.first_difference}.`}</span>`;
const short = text => text.length <= 160 ? text : text.slice(0, 160).replace(/[,;][^,;]*$/, "");
const mark = (claim, i) => html`<li><a class="verdict ${claim.verdict}" href="#claim-${i + 1}" aria-label="${words(claim.verdict)}: ${claim.claim}">
  <span class="tip"><b>${words(claim.verdict)}</b>${claim.claim}<span class="soft">Paper: ${claim.paper}. Here: ${short(claim.ours)}</span></span></a></li>`;
const first = html`<header class="first">
  <p class="kicker"><cite>Fast, Effective BVH Updates for Dynamic Ray-Traced Scenes Using Tree Rotations</cite>
  (Kopta, Kensler, Ize, Spjut, Brunvand and Davis, 2012), rerun on this machine</p>
  <h1>${run.headline}</h1>
  ${run.advice && html`<p class="advice"><b>Use ${run.advice[0]}</b> – ${run.advice[1]}</p>`}
  <p class="ran">${plural(main.length, "scene")}, ${settings.strategies.length} strategies, preset ${settings.preset}${settings.preset === "quick"
    && " (few frames and small pictures: hints, not results)"}, ${plural(settings.threads, "thread")} of ${machine.cpu}, ${machine.started.slice(0, 10)},
  revision ${revision.commit?.slice(0, 10) ?? "unknown"}${revision.dirty && " with uncommitted changes"}.
  ${run.checks.differences ? checks : run.checks.pictures > 0 && run.checks.rays > 0
    && "All strategies gave the same pictures, and the same hits as brute force."}</p>
  ${run.notice && html`<p class="notice">${run.notice}</p>`}
  <div class="verdicts"><p><b>The paper’s claims.</b> ${tally()}.</p><ol class="marks">${claims.map(mark)}</ol></div>
</header>`;

// Strategies that the chart of frame times shows, with their classes of colour; and rebuilds, of which it shows the best.
const BARS = { "refit": "refit", "refit+rotate": "rotate", "auto": "auto" };
const REBUILDS = ["sweep", "binned", "binned-parallel", "lbvh", "hlbvh", "ploc"];
const times = scene => {
  const found = names => names.flatMap(name => scene.strategies.filter(row => row.strategy === name));
  const time = row => row.update_ms.mean + row.trace_ms.mean;
  const bars = [...found(Object.keys(BARS)), ...found(REBUILDS).sort((a, b) => time(a) - time(b)).slice(0, 1)];
  const longest = Math.max(1e-9, ...bars.map(time)), { speedup } = run.more[scene.label];
  const bar = row => {
    const [update, trace] = [row.update_ms.mean, row.trace_ms.mean], parts = `update ${number(update)} ms, trace ${number(trace)} ms`;
    const part = (name, ms) => html`<i class="${name}" style="width:${(100 * ms / longest).toFixed(2)}%"></i>`;
    return html`<li class="bar ${BARS[row.strategy] ?? "rebuild"}" data-strategy="${row.strategy}" tabindex="0" title="${parts}"
      aria-label="${row.strategy}: ${number(time(row))} ms, ${parts}"><span class="name">${row.strategy}</span>
      <span class="track">${part("update", update)}${part("trace", trace)}</span><span class="ms">${number(time(row))}</span></li>`;
  };
  return html`<div class="chart"><h3><a href="#scene-${scene.slug}">${scene.label}</a>
    ${speedup !== null && html`<span class="soft"> rotations: ${speedup.toFixed(2)} × as fast</span>`}</h3><ul>${bars.map(bar)}</ul></div>`;
};
const image = (picture, name = picture.strategy ?? `frame ${picture.frame}`) => {
  const alt = name === "sweep" ? "fresh tree" : name;
  return html`<figure><img src="${run.pictures[picture.file]}" loading="lazy" alt="${alt}"><figcaption>${alt}</figcaption></figure>`;
};
const strip = scene => {
  const of = strategy => scene.images.find(picture => picture.frame === run.more[scene.label].worst && picture.strategy === strategy);
  return html`<div class="strip"><h3><a href="#scene-${scene.slug}">${scene.label}</a></h3><div>${[null, "refit", "refit+rotate"].map(strategy =>
    html`<div ${strategy && html`data-strategy="${strategy}"`}>${image(of(strategy))}</div>`)}</div></div>`;
};
const moving = main.filter(scene => scene.moving && scene.strategies.length), pictured = main.filter(scene => run.more[scene.label].worst !== null);
const evidence = html`<div class="evidence">
  ${moving.length > 0 && html`<section class="times" aria-labelledby="times"><h2 id="times">Frame time</h2>
    <p class="soft">Update, then trace; mean in milliseconds, each scene to its own scale. Gray: the best of the rebuilds.</p>
    <div class="charts">${moving.map(times)}</div></section>`}
  ${pictured.length > 0 && html`<section class="strips" aria-labelledby="strips"><h2 id="strips">Nodes that rays visit</h2>
    <p class="soft">Per pixel: darker is better. Of each scene the pictured frame on which refitting fares worst.</p>
    <div class="charts">${pictured.map(strip)}</div></section>`}
</div>`;

const judged = html`<section><p>${tally()}. Each row says by which rule. Of times measured the sums over the frames that both sides
  were measured on are compared; where a rule speaks of faster, slower or equal, differences of less than 5 % count as none, and where
  the paper says how much, its words set the bound. Where a value that is a tenth more or less would alone change a verdict, the row says that
  it is near the bound. SAH costs are the same in every run.</p>
  <table class="claims"><thead><tr><th>Claim</th><th>In the paper</th><th>Here</th><th>Verdict</th></tr></thead>
  <tbody>${claims.map((claim, i) => html`<tr id="claim-${i + 1}">
    <td>${claim.claim}<span class="soft">, ${claim.source}</span><details><summary>Rule</summary>${claim.rule}</details></td>
    <td data-name="Paper">${claim.paper}</td><td data-name="Here">${claim.ours}</td>
    <td><span class="verdict ${claim.verdict}">${words(claim.verdict)}</span>${claim.first_verdict !== claim.verdict
      && html`<div class="soft">by the bounds written first: ${words(claim.first_verdict)}</div>`}<div class="soft">${claim.why}</div></td></tr>`)}</tbody>
  </table></section>`;

// Of each scene: its stages, a film with heat maps, a table of strategies, their decisions, trees built offline.
const ALWAYS = "as always";
const HEADS = ["Strategy", "Update", "Trace", "Frame", "Worst frame", "SAH cost, last", "× sweep, mean", "× sweep, worst", "Rotations a frame",
  "Height", "Frames"];
const range = ({ mean, max, p10, p90 }) => html`${number(mean)}${max > 0 && html` <br><span class="soft">${number(p10)} – ${number(p90)}</span>`}`;
const strategyRow = row => [row.strategy, html`${row.strategy}${row.accounting && html`<div class="soft light">${row.accounting}</div>`}`,
  range(row.update_ms), range(row.trace_ms), range(row.frame_ms), number(row.frame_ms.max), number(row.last_cost),
  number(row.sah_over_sweep?.mean ?? null), number(row.sah_over_sweep?.max ?? null), number(row.rotations / row.samples), row.greatest_height, row.samples];
const plan = scene => {
  const typical = scene.strategies.find(row => row.strategy === "refit+rotate") ?? scene.strategies[0];
  const ran = name => typical?.stages.filter(stage => stage.stage === name).map(stage =>
    html`<span class="soft">${number(stage.count / Math.max(1, typical.samples))} ${stage.counts}, ${number(stage.mean_ms)} ms</span>`);
  return html`<div class="plan"><p><b>Calls for</b> ${scene.effects.join(", ") || "nothing"}. <b>A frame runs</b></p>
    <ol>${scene.plan.map(name => html`<li><b>${name}</b>${ran(name)}</li>`)}</ol></div>
    ${typical && html`<p class="soft">Counts and times a frame, on average, with ${typical.strategy}; no other stage runs.</p>`}`;
};
const EFFECTS = ["Kind", "Effect", "Count: all", "without", "alone", "ms: all", "without", "alone", "none"];
const effects = scene => scene.effect_costs?.length > 0 && html`<details><summary>What each effect costs</summary>
  <p class="soft">At a twentieth of the triangles where the scene can be made coarser. Simulation: a loop; motion and light: a frame. Counts are those
  of all frames.</p>${table(EFFECTS, 2, scene.effect_costs.map(({ kind, effect, counts, ms }) =>
    [null, kind, effect, ...counts, ...ms.map(time => time.toFixed(3))]))}</details>`;
const film = scene => scene.images.length > 0 && html`<div class="film" tabindex="0" role="group" aria-label="Frames of ${scene.label}">
  ${scene.images.filter(picture => picture.strategy === null).map(({ frame }) =>
    html`<div>${scene.images.filter(picture => picture.frame === frame).map(picture => image(picture))}</div>`)}</div>
  <p class="soft">Below each frame: the nodes that the rays of each pixel visit in the tree of a strategy, from black over blue, red and yellow to
  white at ${thousands(scene.hottest)} or more.</p>`;
const decisions = row => row.decisions.length > 0 && html`<p>What <b>${row.strategy}</b> decided, on the frames measured${
  row.decisions.some(({ decision }) => decision === ALWAYS) && ` (${ALWAYS}: its usual update, and no repair)`}:</p>
  <ul class="decisions">${row.decisions.map(({ decision, frames, first }) =>
    html`<li><b>${plural(frames, "frame")}, first ${first}: ${decision}</b></li>`)}</ul>`;
const described = scene => html`<div id="scene-${scene.slug}" data-scene="${scene.label}"><h3>${scene.label}</h3>
  <p>${capital(scene.about)}. ${thousands(scene.triangles)} triangles, ${thousands(scene.moving)} of them can move. First tree built in
  ${number(scene.build_ms)} ms.${scene.measure_every > 1 && ` One frame in ${scene.measure_every} measured, all updated.`}</p>
  ${scene.notes.map(note => html`<p class="soft">${capital(note)}.</p>`)}${film(scene)}${plan(scene)}${effects(scene)}
  ${scene.strategies.length > 0 && table(HEADS, 1, scene.strategies.map(strategyRow))}${scene.strategies.map(decisions)}
  ${scene.offline.length > 0 && html`<p>Trees built offline over the first frame, and a path-traced picture through each:</p>${table(
    ["Builder", "Build, ms", "SAH cost", "Picture, ms"], 1, scene.offline.map(tree => [null, tree.builder, number(tree.build_ms), number(tree.sah_cost),
      number(tree.path_ms)]))}`}</div>`;

// A scene that serves one claim: the same with other key frames.
const supplement = scene => html`<div id="scene-${scene.slug}" data-scene="${scene.label}"><h3>${scene.label}</h3>
  <p>${capital(scene.about)}. ${thousands(scene.triangles)} triangles. It serves one claim, and no other counts it.</p>
  ${table(HEADS, 1, scene.strategies.map(strategyRow))}</div>`;

// Those of what accuracy costs stand in that section.
const figures = ofAccuracy => run.figures.filter(({ name }) => name.startsWith("accuracy-") === ofAccuracy).map(({ name, title, caption, svg }) =>
  html`<h3 id="${name}">${title}</h3>
  <figure ${name.startsWith("fig6") && html`data-x="frame"`}><div class="scroll" tabindex="0" role="img" aria-label="${title}">${new Markup(svg)}</div>
  <figcaption>${caption}</figcaption></figure>`);

const beside = main.filter(scene => run.more[scene.label].peers.length > 0).map(scene => html`<details open><summary><b>${scene.label}</b></summary>${table(
  ["Contestant", "What", "Median ms", "Least", "Most", "SAH × sweep, mean", "Different", "of rays", "Frames"], 2, run.more[scene.label].peers.map(row =>
    [null, html`${row.contestant}${!row.agrees && html`<div class="soft light">not the same hits</div>`}`, row.what, number(row.median_ms),
      number(row.min_ms), number(row.max_ms), number(row.sah_over_sweep), row.different, row.rays, row.frames]))}</details>`);

const facts = {
  "Processor": `${machine.cpu}, ${machine.cores} hardware threads, ${machine.simd}${machine.flags ? `, flags ${machine.flags}` : ""}`,
  "Memory": machine.memory_gib && `${number(machine.memory_gib)} GiB`,
  "System": machine.os,
  "Compiler": machine.rustc,
  "Load before": machine.load !== null && `${machine.load} processes wanted to run in the minute before`,
  "Started": machine.started,
  "Revision": `${revision.commit ?? "unknown"}${revision.dirty ? ", with uncommitted changes" : ""}`,
  "Settings": `preset ${settings.preset}, ${settings.loops} loops${settings.speed_loops ? ` (of figure 5 ${settings.speed_loops})` : ""}, ${settings.size} × ${
    settings.size} pixels, ${plural(settings.threads, "thread")}, seed ${settings.seed}`,
};
const colophon = html`<section>
  <p>The sweep builder makes one tree over the first frame, with one triangle a leaf. Every strategy starts from a copy of it. On every frame the
  scene is posed once; then each strategy in turn, a different one first each time, updates its tree and renders the frame with primary and shadow rays
  from a point light. Each strategy runs once before the first frame, uncounted. Checks, costs and pictures are not timed. A frame’s time is that of
  update and rendering.</p>
  <p><b>ideal</b> is the rebuild by the sweep builder with its time not counted; <b>ideal-parallel-binned</b> is the serial binned rebuild with its time
  divided by 8, as if it scaled perfectly on the paper’s 8 threads, whatever number of threads the others had. Both are accounting, not measurement.
  <b>sweep</b>, <b>binned-parallel</b>, <b>lbvh</b> and <b>ploc</b> rebuild on all threads, <b>binned</b> on one. <b>paper-binned</b> is a serial binned
  rebuild with bins along the longest axis only, as was common in 2012. It decides no verdict.</p>
  ${settings.reductions.length > 0 && html`<p>Other than in the paper’s protocol: ${settings.reductions.join("; ")}.</p>`}
  <dl>${Object.entries(facts).map(([name, value]) => value && html`<dt>${name}</dt><dd>${value}</dd>`)}</dl>
  <p>${checks}</p>
  <p>Hard cases are no part of this run: <code>cargo test</code> checks that Pivot is stable on them, <code>docs/HARD_CASES.md</code> describes them, and
  <code>cargo xtask compare hard</code> shows what other libraries do with them.</p><h3>Again</h3><pre>${settings.command}</pre>
  <p class="soft">Every row is in <code>frames.csv</code>, the summary for programs in <code>summary.json</code>, figures and pictures as files beside
  this page. <code>cargo xtask reproduce --from DIR</code> draws this page again, <code>--resume</code> goes on after an interrupt.</p></section>`;

document.body.insertAdjacentHTML("afterbegin", written([first, evidence, html`<main>
  ${folded("The paper’s claims", judged)}
  ${folded("What accuracy costs", figures(true).length > 0 && html`<ul>${run.sentences.map(line => html`<li>${line}</li>`)}</ul>
    <p class="soft">The tables are in <code>tables.md</code> beside this page.</p>${figures(true)}`)}
  ${folded("Scenes", html`<section id="scenes"><p>Times are means over all updates and over the pictures measured, in milliseconds; below them the
    middle 80 % of the frames measured. × compares the SAH cost with that of a fresh sweep build on the same frame.</p>${main.map(described)}${supplements.map(supplement)}</section>`)}
  ${folded("Figures", html`<section id="figures">${figures(false)}</section>`)}
  ${folded("Beside other libraries", beside.length > 0 && html`<section id="peers"><p>The same motion and the same rays; contestants take turns frame by
    frame. An update is the time from new positions to a tree that can be traced. A frame is update and trace. “Different” counts rays whose answer
    differs from the reference’s.</p>${beside}</section>`)}
  ${folded("How it was measured", colophon)}
</main>`]));

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

// A strategy under the pointer, or with the focus, stands out wherever it is shown.
const marks = all("[data-strategy]:not([data-strategy=''])").map(element => [element, element.dataset.strategy]);
const pointed = new Map(marks);
const point = name => marks.forEach(([element, its]) => element.classList.toggle("dim", name !== undefined && its !== name));
const nameAt = target => pointed.get(target) ?? pointed.get(target.closest?.("[data-strategy]")?.dataset.strategy || undefined);
for (const event of ["pointerover", "focusin"]) addEventListener(event, ({ target }) => point(nameAt(target)));
addEventListener("focusout", () => point());

// A line at the same frame in all charts over frames: their panels have the same size.
const PANEL = 520, over = all("figure svg").filter(svg => svg.closest("figure").dataset.x === "frame");
const lines = over.flatMap(svg => [0, 1].map(panel => {
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  line.setAttribute("class", "cursor");
  line.setAttribute("y1", 46);
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
