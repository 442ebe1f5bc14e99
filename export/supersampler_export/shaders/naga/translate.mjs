/**
 * Translate WGSL with naga. Reads {"to", "options", "sources": {name: code}} from stdin, and writes {name: base64}, or
 * {"error": text}, to stdout.
 */

import { translate } from "naga-wasm";

const chunks = [];
for await (const chunk of process.stdin) chunks.push(chunk);
const { to, options, sources } = JSON.parse(Buffer.concat(chunks).toString("utf8"));
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
