/**
 * Translate WGSL with naga. Reads {"to", "options", "sources": {name: code}} from the file that is named, and writes
 * {name: base64}, or {"error": text}, to stdout.
 */

import { readFileSync } from "node:fs";
import { translate } from "naga-wasm";

const { to, options, sources } = JSON.parse(readFileSync(process.argv[2], "utf8"));
const translated = {};
for (const [name, source] of Object.entries(sources)) {
  try {
    const code = translate({ from: "wgsl", source, to, options });
    const bytes =
      typeof code === "string" ? code : new Uint8Array(code.buffer, code.byteOffset, code.byteLength);
    translated[name] = Buffer.from(bytes).toString("base64");
  } catch (error) {
    process.stdout.write(JSON.stringify({ error: `${name}: ${error.formatted ?? error.message}` }));
    process.exit(0);
  }
}
process.stdout.write(JSON.stringify(translated));
