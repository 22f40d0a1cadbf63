// Compiles WGSL modules with Dawn, the implementation of WebGPU in Chromium, and makes their
// pipelines on a device without extra features or limits, as a browser gives it.
// Arguments: the folder of `node_modules/webgpu`, then files. Prints one line a file; exit status 1
// if one fails, 3 without an adapter.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const [folder, ...files] = process.argv.slice(2);
const { create, globals } = createRequire(join(folder, "index.js"))("webgpu");
Object.assign(globalThis, globals);
const gpu = create([]);
const adapter = await gpu.requestAdapter();
if (!adapter) {
  console.log("no adapter");
  process.exit(3);
}
console.log(`adapter: ${adapter.info.description || adapter.info.device || adapter.info.vendor}`);
const device = await adapter.requestDevice();

/// Names of the entry points of a stage.
function entries(text, stage) {
  const found = text.matchAll(new RegExp(`@${stage}\\b[^{;]*?\\bfn\\s+(\\w+)`, "g"));
  return [...found].map((match) => match[1]);
}

/// Values of the constants that a pipeline has to state.
function constants(text) {
  const stated = text.matchAll(/^override\s+(\w+)\s*:[^=;]*;/gm);
  return Object.fromEntries([...stated].map((match) => [match[1], 1]));
}

/// Formats of what a fragment shader returns.
function targets(text, entry) {
  const [, out] = text.match(new RegExp(`fn\\s+${entry}\\b[^{]*->([^{]*)\\{`)) ?? [null, ""];
  const struct = text.match(new RegExp(`struct\\s+${out.trim()}\\s*\\{([^}]*)\\}`));
  const types = (struct?.[1] ?? out).matchAll(/@location\(\d+\)[^@]*?(?:vec(\d)<)?(f32|u32|i32)/g);
  const channels = { 2: "rg", 4: "rgba" };
  const formats = { f32: "16float", u32: "16uint", i32: "16sint" };
  return [...types].map(([, size, type]) => ({ format: (channels[size] ?? "r") + formats[type] }));
}

/// Makes the pipelines of a module. Each fragment shader is paired with the first vertex shader.
async function pipelines(module, text) {
  const layout = "auto";
  const stated = constants(text);
  for (const entryPoint of entries(text, "compute")) {
    await device.createComputePipelineAsync({ layout, compute: { module, entryPoint, constants: stated } });
  }
  const [vertex] = entries(text, "vertex");
  for (const entryPoint of entries(text, "fragment")) {
    const hasDepth = /@builtin\(frag_depth\)/.test(text);
    await device.createRenderPipelineAsync({
      layout,
      vertex: { module, entryPoint: vertex, constants: stated },
      fragment: { module, entryPoint, constants: stated, targets: targets(text, entryPoint) },
      depthStencil: hasDepth
        ? { format: "depth32float", depthCompare: "less", depthWriteEnabled: true }
        : undefined,
    });
  }
}

let failed = 0;
for (const file of files) {
  const text = readFileSync(file, "utf8");
  let fault = null;
  device.pushErrorScope("validation");
  try {
    const module = device.createShaderModule({ code: text });
    const errors = (await module.getCompilationInfo()).messages.filter((m) => m.type === "error");
    if (errors.length > 0) {
      fault = errors.map((m) => `line ${m.lineNum}: ${m.message}`).join("; ");
    } else {
      await pipelines(module, text);
    }
  } catch (error) {
    fault = String(error.message ?? error);
  }
  const invalid = await device.popErrorScope();
  fault ??= invalid?.message;
  failed += fault ? 1 : 0;
  console.log(`${fault ? "FAILED" : "ok"} ${file}${fault ? `: ${fault}` : ""}`);
}
process.exit(failed > 0 ? 1 : 0);
