// The worst cells as a table, and the face quality for finite-volume solvers.

import { byId, coordinates, element, quality, whole } from "./format.js";

export function showWorst({ of, step, cells }, threshold) {
  byId("worst-of").textContent = cells.length ? (of === "uploaded" ? "as uploaded" : `${of}, step ${step}`) : "";
  const heads = ["cell", "quality", "size", "skew", "centre"];
  const row = (cell) => {
    const below = threshold !== null && cell.metric < threshold ? "below" : undefined;
    return element(
      "tr",
      {},
      element("td", { class: "wraps", text: `${cell.type} ${cell.cell}${cell.partition ? ` of ${cell.partition}` : ""}` }),
      element("td", { class: below, text: quality(cell.metric) }),
      element("td", { text: quality(cell.size) }),
      element("td", { text: quality(cell.skew) }),
      element("td", { class: "wraps", text: coordinates(cell.centre) }),
    );
  };
  byId("worst").replaceChildren(
    element("thead", {}, element("tr", {}, ...heads.map((text) => element("th", { scope: "col", text })))),
    element("tbody", {}, ...cells.map(row)),
  );
}

const degrees = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(1)}°`);

const FACES = [
  ["largest non-orthogonality", "max_non_orthogonality", degrees],
  ["faces above 65°", "faces_above_65", whole],
  ["faces above 75°", "faces_above_75", whole],
  ["largest skewness", "max_skewness", quality],
  ["least volume ratio", "min_volume_ratio", quality],
  ["shortest edge, of that at rest", "shortest_edge", quality],
  ["smallest face, of that at rest", "smallest_face", quality],
];

/** For the mesh of the last Move, if it requested faces; otherwise unknown. `ahead` says how far it goes on. */
export function showFaces(faces, ahead, step) {
  const { before, after } = faces ?? {};
  byId("faces-panel").hidden = !after;
  if (!after) return;
  byId("faces-of").textContent = [`step ${step}`, ahead].filter(Boolean).join("; ");
  const heads = ["as uploaded", "now"];
  const row = ([name, key, shown]) =>
    element("tr", {}, element("th", { scope: "row", text: name }), element("td", { text: shown(before?.[key]) }), element("td", { text: shown(after[key]) }));
  byId("faces").replaceChildren(
    element("thead", {}, element("tr", {}, element("td"), ...heads.map((text) => element("th", { scope: "col", text })))),
    element("tbody", {}, ...FACES.map(row)),
  );
}
