// The worst cells, and what people should know of: warnings, refusals, turns of the session's life.

import { byId, clock, coordinates, element, quality } from "./format.js";

const TONES = { warning: "warn", refused: "bad", failed: "bad", boundary_ended: "warn", suspended: "warn", frozen: "bad" };
const LIFE = { resumed: "resumed", suspended: "suspended: no holder within the lease", joined: "a client joined again", frozen: "frozen: the disk failed", closed: "closed, kept", failed: "failed", boundary_ended: "boundary log ended" };

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
      element("td", { text: `${cell.type} ${cell.cell}${cell.partition ? ` of ${cell.partition}` : ""}` }),
      element("td", { class: below, text: quality(cell.metric) }),
      element("td", { text: quality(cell.size) }),
      element("td", { text: quality(cell.skew) }),
      element("td", { text: coordinates(cell.centre) }),
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

export function showEvents(notable, told) {
  byId("events-count").textContent = told > notable.length ? `${told} in all` : "";
  const item = (event) => {
    const head = element("div", { class: "head" }, element("span", { text: clock(event.at) }), element("span", { text: `step ${event.step ?? "–"}` }));
    if (event.event === "refused") head.append(element("span", { class: "code", text: event.code }), element("span", { text: event.request }));
    else head.append(element("span", { class: "code", text: LIFE[event.event] ?? event.event }));
    if (event.times > 1) head.append(element("span", { text: `× ${event.times}` }));
    const row = element("li", { "data-tone": TONES[event.event] ?? "" }, head);
    if (event.message) row.append(element("p", { text: event.message }));
    if (event.hint) row.append(element("p", { class: "quiet", text: event.hint }));
    return row;
  };
  const key = JSON.stringify(notable);
  const list = byId("events");
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...(notable.length ? notable.map(item) : [element("li", { class: "quiet", text: "None so far." })]));
}
