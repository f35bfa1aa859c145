// What the report looks like and does in a browser; the test reads the answer from the title.
addEventListener("load", async () => {
  const failed = [], find = selector => document.querySelector(selector);
  const check = (what, ok) => { if (!ok) failed.push(what); };
  const all = selector => [...document.querySelectorAll(selector)];
  const bottom = selector => find(selector).getBoundingClientRect().bottom;
  check("nothing is wider than the screen", document.documentElement.scrollWidth <= innerWidth);
  check("the answer and the verdicts are on the first screen", bottom("h1") < innerHeight && bottom(".marks") < innerHeight);
  check("frame times have bars", all(".bar .track").every(bar => bar.offsetWidth > 40));
  check("every picture has words", all("img").every(image => image.alt) && all("img").length > 0);
  check("every chart and mark has a label", all(".scroll[role=img], .marks a, .bar").every(one => one.getAttribute("aria-label")));

  const tip = find(".marks li:last-child .tip"), display = () => getComputedStyle(tip).display;
  check("tips are hidden", display() === "none");
  tip.parentElement.focus({ focusVisible: true });
  check("the mark with the focus shows its tip", display() === "block");
  const { left, right } = tip.getBoundingClientRect();
  check("the tip is on the screen", left >= 0 && right <= innerWidth);

  const claim = document.getElementById("claim-1");
  check("parts are closed", !claim.checkVisibility());
  location.hash = "claim-1";
  await new Promise(done => setTimeout(done, 50));
  check("a link opens its part", claim.checkVisibility());

  all("details").forEach(part => { part.open = true; });
  check("opened, nothing is wider than the screen", document.documentElement.scrollWidth <= innerWidth);
  const table = find("[data-scene] table"), head = table.querySelectorAll("thead th")[3];
  const rows = () => [...table.tBodies[0].rows];
  // As cells show them: to three digits.
  const shown = row => number(run.scenes[0].strategies.find(one => one.strategy === row.dataset.strategy).frame_ms.mean);
  const times = () => rows().map(row => parseFloat(shown(row).replace(/\u202f/g, "")));
  check("a cell begins with its mean, apart from deciles", rows().every(row => row.cells[3].textContent.startsWith(`${shown(row)} `)));
  for (const sign of [1, -1]) {
    head.querySelector("button").click();
    check("tables sort both ways", times().every((time, i, all) => i === 0 || sign * (time - all[i - 1]) >= 0));
  }
  find(".bar.rotate").dispatchEvent(new PointerEvent("pointerover", { bubbles: true }));
  const dim = [...table.tBodies[0].rows].filter(row => row.classList.contains("dim")).map(row => row.dataset.strategy);
  check("other strategies step back", dim.includes("refit") && !dim.includes("refit+rotate"));
  check("in figures, too", all("figure svg polyline.dim").length > 0 && all("figure svg polyline:not(.dim)").length > 0);

  const chart = find("figure[data-x=frame] svg"), { left: from, top } = chart.getBoundingClientRect();
  chart.dispatchEvent(new PointerEvent("pointermove", { clientX: from + 200, clientY: top + 100 }));
  check("all charts over frames show the same frame", all("figure[data-x=frame] .cursor").every(line => line.classList.contains("on")));
  document.title = `failed: ${failed.join("; ")}.`;
});
