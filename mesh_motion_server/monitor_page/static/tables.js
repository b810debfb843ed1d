// The worst cells as a table.

import { byId, coordinates, element, quality } from "./format.js";

/** go(cell) shows it in the mesh. */
export function showWorst({ of, step, cells }, threshold, go) {
  byId("worst-of").textContent = cells.length ? (of === "uploaded" ? "as uploaded" : `${of}, step ${step}`) : "";
  const heads = ["cell", "quality", "size", "skew", "centre", ""];
  const row = (cell) => {
    const button = element("button", { type: "button", text: "Show", "aria-label": `Show ${cell.type} ${cell.cell} in the mesh` });
    button.addEventListener("click", () => go(cell));
    const below = threshold !== null && cell.metric < threshold ? "below" : undefined;
    return element(
      "tr",
      {},
      element("td", { class: "wraps", text: `${cell.type} ${cell.cell}${cell.partition ? ` of ${cell.partition}` : ""}` }),
      element("td", { class: below, text: quality(cell.metric) }),
      element("td", { text: quality(cell.size) }),
      element("td", { text: quality(cell.skew) }),
      element("td", { class: "wraps", text: coordinates(cell.centre) }),
      element("td", {}, button),
    );
  };
  const place = byId("worst");
  const focused = [...place.querySelectorAll("button")].indexOf(document.activeElement);
  place.replaceChildren(
    element("thead", {}, element("tr", {}, ...heads.map((text) => (text ? element("th", { scope: "col", text }) : element("td"))))),
    element("tbody", {}, ...cells.map(row)),
  );
  place.querySelectorAll("button")[focused]?.focus();
}
