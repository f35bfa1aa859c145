// The viewer's thread beside the page, and the threads that trace with it: all of them run this file.
// The module is built for wasm32-wasip1-threads; what it asks of its system is answered here.

const INVALID = 8, UNSUPPORTED = 52;
const PAGES = 64 * 1024;
const memory = { bytes: () => new DataView(memory.shared.buffer) };

// Answers to the module. Whatever is not here is not supported: there are no files.
const system = {
  clock_time_get(_clock, _precision, to) {
    const now = performance.timeOrigin + performance.now();
    memory.bytes().setBigUint64(to, BigInt(Math.round(now * 1000)) * 1000n, true);
    return 0;
  },
  random_get(to, count) {
    new Uint8Array(memory.shared.buffer, to, count).set(crypto.getRandomValues(new Uint8Array(count)));
    return 0;
  },
  fd_write(_file, parts, count, written) {
    let text = "", length = 0;
    for (let i = 0; i < count; i++) {
      const [at, size] = [0, 4].map(offset => memory.bytes().getUint32(parts + 8 * i + offset, true));
      text += new TextDecoder().decode(new Uint8Array(memory.shared.buffer, at, size).slice());
      length += size;
    }
    memory.bytes().setUint32(written, length, true);
    console.error(text);
    return 0;
  },
  environ_sizes_get(count, size) {
    memory.bytes().setUint32(count, 0, true);
    memory.bytes().setUint32(size, 0, true);
    return 0;
  },
  environ_get: () => 0,
  sched_yield: () => 0,
  fd_prestat_get: () => INVALID,
  proc_exit(code) { throw new Error(`the viewer ended with code ${code}`); },
};

// Threads that wait for their work, and the number of the next.
const idle = [];
let next = 1;

async function instance(module) {
  const imports = { env: { memory: memory.shared }, wasi: { "thread-spawn": spawn }, wasi_snapshot_preview1: {} };
  for (const { module: from, name } of WebAssembly.Module.imports(module)) {
    if (from === "wasi_snapshot_preview1") imports[from][name] = system[name] ?? (() => UNSUPPORTED);
  }
  return (await WebAssembly.instantiate(module, imports)).exports;
}

function spawn(argument) {
  const thread = idle.pop();
  thread?.postMessage([next, argument]);
  return thread ? next++ : -1;
}

// A thread must be running when it is asked for: this one may not return to its events before. One that cannot start is not
// counted.
function thread(module) {
  return new Promise(ready => {
    const worker = new Worker(import.meta.url, { type: "module" });
    worker.onmessage = () => { idle.push(worker); ready(); };
    worker.onerror = ready;
    worker.postMessage({ module, shared: memory.shared });
  });
}

const unpacked = ({ body }, type) =>
  new Response(body.pipeThrough(new DecompressionStream("gzip")), { headers: { "Content-Type": type } });

let viewer;

async function begin(width, height, threads) {
  const module = await WebAssembly.compileStreaming(unpacked(await fetch("viewer.wasm.gz"), "application/wasm"));
  memory.shared = new WebAssembly.Memory({ initial: 64 * 1024 * 1024 / PAGES, maximum: 2 ** 31 / PAGES, shared: true });
  // The first instance is that of the main thread: it lays out the memory.
  const main = await instance(module);
  main._initialize();
  await Promise.all(Array.from({ length: threads - 1 }, () => thread(module)));
  main.start(width, height, 1 + idle.length);
  viewer = main;
  size = [width, height];
  wake();
}

// One picture after the other, none while nothing changes, and at most two that the page has not shown yet.
const MOST_AHEAD = 2;
let size, wanted = false, running = false, ahead = 0, last = performance.now(), busy = last, slice = 0;
const turns = new MessageChannel();
turns.port1.onmessage = () => { running = false; turn(); };
function wake() {
  wanted = true;
  if (viewer && !running && ahead < MOST_AHEAD) {
    running = true;
    turns.port2.postMessage(0);
  }
}

function turn() {
  if (ahead >= MOST_AHEAD) return;
  wanted = false;
  const start = performance.now();
  const at = viewer.draw(Math.min(0.2, Math.max(0, (start - last) / 1000)));
  last = start;
  const [width, height] = size;
  const pixels = new Uint8ClampedArray(memory.shared.buffer, at, 4 * width * height).slice();
  const loading = viewer.is_loading() === 1;
  ahead += 1;
  postMessage({ pixels, width, height, loading, slice }, [pixels.buffer]);
  // What takes long comes after the picture that says so: a step towards a scene, and costs of fresh trees once that has
  // been drawn.
  const begun = performance.now(), todo = viewer.serve(), makes = viewer.is_loading() === 1;
  if (todo & 1) postMessage({ save: true });
  if (todo & 2) fetchKeys();
  if (makes || performance.now() - busy > 2000 && viewer.fresh()) busy = performance.now();
  slice = Math.max(slice, performance.now() - begun);
  const pause = makes ? 0 : viewer.idle();
  if (pause > 0.004) setTimeout(wake, 1000 * pause);
  else if (makes || !viewer.is_at_rest()) wake();
}

// The dragon's key frames. If they cannot be had, they are simulated here, which takes seconds.
async function fetchKeys() {
  const keys = await fetch("exploding-dragon.keys.gz").then(file => unpacked(file, "").arrayBuffer())
    .catch(() => new ArrayBuffer(0));
  hand("", new Uint8Array(keys));
  const begun = performance.now();
  viewer.keys();
  slice = Math.max(slice, performance.now() - begun);
  wake();
}

// Puts a name and a file into the module's memory. Gives the number of bytes of the name.
function hand(name, content) {
  const label = new TextEncoder().encode(name), bytes = label.length + content.length;
  const at = viewer.inbox(bytes), inbox = new Uint8Array(memory.shared.buffer, at, bytes);
  inbox.set(label);
  inbox.set(content, label.length);
  return label.length;
}

// What the page says: a function and its arguments.
const orders = {
  begin: (...all) => begin(...all).catch(error => postMessage({ failed: String(error) })),
  shown() { ahead -= 1; if (wanted) wake(); },
  open: (name, content) => viewer.open_file(hand(name, new Uint8Array(content))),
  resize(width, height) { size = [width, height]; viewer.resize(width, height); },
  measure() { slice = 0; },
};
onmessage = async ({ data }) => {
  if (data.module) {
    memory.shared = data.shared;
    const thread = await instance(data.module);
    onmessage = ({ data: [number, argument] }) => thread.wasi_thread_start(number, argument);
    postMessage("ready");
  } else {
    const [order, ...all] = data;
    if (order === "begin") return orders.begin(...all);
    if (!viewer) return;
    (orders[order] ?? viewer[order])(...all);
    if (order !== "shown") wake();
  }
};
