// Runs the fingerprints as WebAssembly. The module gets nothing from the host: no clock, no threads, no files.
import { readFileSync } from "node:fs";

const [, , label, moduleFile, listFile] = process.argv;
const { instance } = await WebAssembly.instantiate(readFileSync(moduleFile), {});
const { fingerprint_count, fingerprint } = instance.exports;
const list = readFileSync(listFile, "utf8").trim().split("\n");
const count = fingerprint_count();
let wrong = Math.abs(list.length - count);
list.forEach((line, i) => {
  const [name, listed] = line.split(" ");
  const found = BigInt.asUintN(64, fingerprint(i)).toString(16).padStart(16, "0");
  if (found !== listed) {
    console.log(`  ${label}: listed ${name} ${listed}, found ${found}`);
    wrong += 1;
  }
});
console.log(`${label}: ${count} fingerprints, ${wrong} differences`);
process.exit(wrong > 0 ? 1 : 0);
