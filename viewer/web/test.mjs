// Tests the page in a headless Chromium: it draws, plays, takes keys and the mouse, switches strategies and scenes, and shows
// a file that is dropped on it, on one thread and on all.   node viewer/web/test.mjs FOLDER [SCREENSHOTS]
// FOLDER is what `cargo xtask web` wrote. Exit code 1 if anything fails; 0, and it says so, where there is no Chromium.
import { spawn, spawnSync } from "node:child_process";
import { mkdtempSync, readdirSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { availableParallelism, tmpdir } from "node:os";
import { extname, join } from "node:path";

const [, , folder, screenshots] = process.argv;
const chromium = ["chromium", "chromium-browser", "google-chrome"].find(name => !spawnSync(name, ["--version"]).error);
if (!chromium) {
  console.log("skipped: no Chromium");
  process.exit(0);
}
// A plain file server: without the headers that threads need.
const types = { ".html": "text/html", ".js": "text/javascript" };
const server = createServer((request, response) => {
  const { pathname } = new URL(request.url, "http://localhost");
  const name = pathname === "/" ? "index.html" : pathname.slice(1);
  try {
    const body = readFileSync(join(folder, name));
    response.setHeader("Content-Type", types[extname(name)] ?? "application/octet-stream");
    response.end(body);
  } catch {
    response.writeHead(404).end();
  }
}).listen(0, "127.0.0.1");
const profile = mkdtempSync(join(tmpdir(), "page-"));
const browser = spawn(chromium, ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe",
  `--user-data-dir=${profile}`, "--window-size=640,700"], { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
const end = code => {
  browser.kill();
  server.close();
  browser.once("exit", () => {
    // Processes of the browser may still write there.
    try { rmSync(profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 200 }); } catch { /* left in /tmp */ }
    process.exit(code);
  });
};
const late = setTimeout(() => { console.log("failed: no end within 180 s"); end(1); }, 180_000);
const sleep = ms => new Promise(done => setTimeout(done, ms));

// The protocol of Chromium's developer tools: JSON between zero bytes.
const waiting = new Map(), errors = [];
let session, sent = 0, rest = "";
browser.stdio[4].on("data", data => {
  const messages = (rest + data).split("\0");
  rest = messages.pop();
  for (const { id, method, params, result } of messages.map(text => JSON.parse(text))) {
    waiting.get(id)?.(result);
    if (method === "Runtime.exceptionThrown") errors.push(params.exceptionDetails.exception?.description);
  }
});
const call = (method, params = {}) => new Promise(done => {
  waiting.set(++sent, done);
  browser.stdio[3].write(`${JSON.stringify({ id: sent, method, params, sessionId: session })}\0`);
});
const { targetId } = await call("Target.createTarget", { url: "about:blank" });
session = (await call("Target.attachToTarget", { targetId, flatten: true })).sessionId;
const evaluate = async expression =>
  (await call("Runtime.evaluate", { expression, awaitPromise: true, returnByValue: true })).result.value;
const pixels = () => evaluate(`(() => {
  const { data } = document.querySelector("canvas").getContext("2d").getImageData(0, 0, 640, 360);
  let hash = 0, colors = new Set();
  for (let i = 0; i < data.length; i += 4) {
    const color = data[i] << 16 | data[i + 1] << 8 | data[i + 2];
    hash = (hash * 31 + color) | 0;
    colors.add(color);
  }
  return { hash, colors: colors.size };
})()`);
let failures = 0;
const check = (what, ok, figures = "") => {
  failures += ok ? 0 : 1;
  console.log(`${ok ? "ok" : "FAILED"}: ${what} ${figures}`);
};
const key = async text => {
  await call("Input.dispatchKeyEvent", { type: "keyDown", text, key: text });
  await call("Input.dispatchKeyEvent", { type: "keyUp", key: text });
};
const mouse = (type, x, y) => call("Input.dispatchMouseEvent", { type, x, y, button: "left", clickCount: 1 });
const until = async (what, ms) => {
  const start = performance.now();
  while (performance.now() - start < ms) {
    if (await what()) return performance.now() - start;
    await sleep(20);
  }
  return NaN;
};
const shoot = async name => {
  if (!screenshots) return;
  const { data } = await call("Page.captureScreenshot");
  writeFileSync(join(screenshots, `${name}.png`), Buffer.from(data, "base64"));
};
const changes = async (what, act) => {
  await sleep(700);
  const before = await pixels();
  await act();
  await sleep(700);
  check(what, (await pixels()).hash !== before.hash);
};

await call("Runtime.enable");
await call("Page.enable");
// Loads the page and waits for its first scene. Gives the pixels of the first frame with all its samples.
const visit = async (threads, query) => {
  const begun = performance.now();
  await call("Page.navigate", { url: `http://127.0.0.1:${server.address().port}/${query}` });
  const first = await until(async () => (await pixels().catch(() => null))?.colors > 500, 20_000);
  check("the first scene is drawn", first > 0, `after ${(performance.now() - begun).toFixed(0)} ms`);
  check(`threads: ${threads}`, await evaluate("window.threads") === threads);
  await until(() => evaluate("window.rate > 0"), 5000);
  await shoot(`first-${threads}`);
  await key(" ");
  await call("Input.dispatchKeyEvent", { type: "keyDown", key: "Home" });
  await key("u"); // Without the overlay, where times stand.
  let last, still = 0;
  await until(async () => {
    const { hash } = await pixels();
    [last, still] = [hash, hash === last ? still + 1 : 0];
    return still > 50;
  }, 20_000);
  await key("u");
  await key("u");
  return last;
};
const play = async () => {
  await key(" ");
  for (const scene of ["bart-museum", "exploding-dragon"]) {
    await sleep(300);
    const scenes = await evaluate("measure(), window.shown"), before = await pixels(), start = Date.now();
    await key("n");
    const shown = await until(() => evaluate(`window.shown > ${scenes}`), 30_000);
    check(`${scene} is shown`, shown > 0 && (await pixels()).hash !== before.hash,
      `after ${await evaluate("window.shownAt") - start} ms, longest step of making it ${(await evaluate("window.slice")).toFixed(0)} ms`);
    await sleep(4000);
    check(`${scene} plays`, await evaluate("window.rate > 1"), `${(await evaluate("window.rate")).toFixed(1)} pictures a second`);
    await shoot(scene);
  }
};

const alone = await visit(1, "?threads=1");
const calm = await pixels();
await key("h");
await sleep(600);
check("heat", (await pixels()).hash !== calm.hash);
await key("h");
await changes("another strategy on the left", () => key("1"));
await changes("the mouse turns the scene", async () => {
  await mouse("mousePressed", 400, 150);
  await mouse("mouseMoved", 440, 170);
  await mouse("mouseReleased", 440, 170);
});
await play();
await key(" ");
await changes("a dropped file", () => evaluate(`(() => {
  const text = "v -1 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n", transfer = new DataTransfer();
  transfer.items.add(new File([text], "one.obj"));
  dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
})()`));
await changes("a file that is none of them leaves a message", () => evaluate(`(() => {
  const transfer = new DataTransfer();
  transfer.items.add(new File(["nothing"], "broken.glb"));
  dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
})()`));
await shoot("last");
const together = await visit(Math.min(availableParallelism(), 16), "");
check("all threads draw the same picture", alone === together);
await play();
const size = readdirSync(folder).reduce((sum, name) => sum + statSync(join(folder, name)).size, 0);
check("the page has at most 3 MB", size <= 3e6, `${(size / 1e6).toFixed(2)} MB`);
check("no errors", errors.length === 0, errors.join("; "));
clearTimeout(late);
end(failures > 0 ? 1 : 0);
