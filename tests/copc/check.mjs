// Compares COPC files with what the npm package copc reads of them: every voxel has its points and
// lies in its parent, and queries of boxes by voxels give the points that a search through all points
// gives. Writes the steps of all points beside each file, for check.py to compare.
//
// Usage: node check.mjs FOLDER FILE.copc.laz ...    FOLDER has node_modules/copc

import { createRequire } from "node:module";
import { writeFileSync } from "node:fs";
import path from "node:path";
import process from "node:process";

const [folder, ...files] = process.argv.slice(2);
const require = createRequire(path.join(path.resolve(folder), "package.json"));
const { Copc } = require("copc");

/** All nodes of all pages. */
async function nodesOf(file, copc) {
  const nodes = {};
  const pages = [copc.info.rootHierarchyPage];
  while (pages.length > 0) {
    const page = await Copc.loadHierarchyPage(file, pages.pop());
    Object.assign(nodes, page.nodes);
    pages.push(...Object.values(page.pages));
  }
  return nodes;
}

function fail(what) {
  throw new Error(what);
}

async function check(file) {
  const copc = await Copc.create(file);
  const { cube } = copc.info;
  const nodes = await nodesOf(file, copc);
  const voxels = [];
  for (const [key, node] of Object.entries(nodes)) {
    const [level, ...place] = key.split("-").map(Number);
    const above = [level - 1, ...place.map((p) => p >> 1)].join("-");
    if (level > 0 && !(above in nodes)) fail(`${key} has no voxel above it`);
    const edge = (cube[3] - cube[0]) / 2 ** level;
    const low = place.map((p, axis) => cube[axis] + p * edge);
    const points = [];
    if (node.pointCount > 0) {
      const view = await Copc.loadPointDataView(file, copc, node);
      const get = ["X", "Y", "Z"].map(view.getter);
      for (let i = 0; i < view.pointCount; i++) points.push(get.map((of) => of(i)));
      if (view.pointCount !== node.pointCount) fail(`${key} has ${view.pointCount} points`);
    }
    for (const p of points) {
      const inside = p.every((c, axis) => c >= low[axis] && c <= low[axis] + edge);
      if (!inside) fail(`a point of ${key} lies outside of it: ${p}`);
    }
    voxels.push({ level, low, edge, points });
  }
  const all = voxels.flatMap((voxel) => voxel.points);
  if (all.length !== copc.header.pointCount) fail(`${all.length} points`);
  let seed = 1;
  const dice = () => ((seed = (seed * 48271) % 2147483647) / 2147483647);
  for (let i = 0; i < 12; i++) {
    const ends = [0, 1, 2].map((axis) => {
      const [least, greatest] = [copc.header.min[axis], copc.header.max[axis]];
      return [dice(), dice()].map((t) => least + t * (greatest - least)).sort((a, b) => a - b);
    });
    const holds = (p) => p.every((c, axis) => ends[axis][0] <= c && c <= ends[axis][1]);
    const meets = ({ low, edge }) =>
      low.every((c, axis) => c <= ends[axis][1] && c + edge >= ends[axis][0]);
    const found = voxels.filter(meets).flatMap((voxel) => voxel.points.filter(holds));
    if (found.length !== all.filter(holds).length) fail(`a box has ${found.length} points`);
  }
  const { scale, offset } = copc.header;
  const steps = new Int32Array(all.length * 3);
  all.forEach((p, i) =>
    p.forEach((c, axis) => (steps[i * 3 + axis] = Math.round((c - offset[axis]) / scale[axis]))),
  );
  writeFileSync(`${file}.steps`, steps);
  console.log(`${file}: ok by copc.js, ${all.length} points, ${voxels.length} voxels`);
}

for (const file of files) await check(file);
