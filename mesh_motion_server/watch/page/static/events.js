// Warnings, refusals and state changes of a session: a list that changes only for news, and for screen readers a log that
// gets each message once. The list itself is not a log: a screen reader would read it completely for each opened session.

import { arrange, byId, clock, element } from "./format.js";

const TONES = { warning: "warn", refused: "bad", failed: "bad", boundary_ended: "warn", suspended: "warn", frozen: "bad" };
const LIFE = { resumed: "resumed", suspended: "suspended: no holder within the lease", joined: "a client joined again", frozen: "frozen: the disk failed", closed: "closed, kept", failed: "failed", boundary_ended: "boundary log ended" };
/** Maximum number of messages announced at a time; the rest is counted. */
const ANNOUNCED = 3;
/** Time after which a repeated message is announced again. */
const REPEAT_SECONDS = 60;
const LOG_LINES = 12;

const what = (event) => (event.event === "refused" ? event.code : (LIFE[event.event] ?? event.event));

function spoken(event) {
  const times = event.times > 1 ? `, ${event.times} times` : "";
  return `Step ${event.step ?? "unknown"}: ${event.event === "refused" ? `${event.request} refused, ` : ""}${what(event)}${times}. ${event.message ?? ""}`;
}

/** The content of an event's row. */
function content(event) {
  const head = element("div", { class: "head" }, element("span", { text: clock(event.at) }), element("span", { text: `step ${event.step ?? "–"}` }));
  head.append(element("span", { class: "code", text: what(event) }));
  if (event.event === "refused") head.append(element("span", { text: event.request }));
  if (event.times > 1) head.append(element("span", { text: `× ${event.times} since ${clock(event.since)}` }));
  const parts = [head];
  if (event.message) parts.push(element("p", { text: event.message }));
  if (event.hint) parts.push(element("p", { class: "quiet", text: event.hint }));
  return parts;
}

/** Stable names of events, newest first; several events of one moment may have the same text. */
function named(notable) {
  const seen = new Map();
  const names = notable.toReversed().map((event) => {
    const name = JSON.stringify([event.since ?? event.at, event.event, event.code, event.message, event.request]);
    seen.set(name, (seen.get(name) ?? 0) + 1);
    return `${name} ${seen.get(name)}`;
  });
  return names.reverse();
}

export class Events {
  constructor() {
    this.list = byId("events");
    this.log = byId("news");
    this.none = element("li", { class: "quiet", text: "None so far." });
    this.session = "";
  }

  /** notable: newest first; total: number of all events. */
  show(session, notable, total) {
    const count = total > notable.length ? `${total} in all` : "";
    if (byId("events-count").textContent !== count) byId("events-count").textContent = count;
    const isNew = session !== this.session;
    if (isNew) {
      this.session = session;
      this.rows = new Map();
      this.latest = -Infinity;
      this.spokenAt = new Map();
      this.log.replaceChildren();
    }
    const names = named(notable);
    if (!isNew) this.announce(notable, names);
    for (const name of this.spokenAt.keys()) if (!names.includes(name)) this.spokenAt.delete(name);
    this.latest = Math.max(this.latest, notable[0]?.at ?? -Infinity);
    this.rows = new Map(names.map((name, k) => [name, this.row(this.rows.get(name), notable[k])]));
    const wanted = notable.length ? [...this.rows.values()].map(({ row }) => row) : [this.none];
    arrange(this.list, wanted);
  }

  row(known, event) {
    const key = JSON.stringify(event);
    if (known?.key === key) return known;
    const row = known?.row ?? element("li", { "data-tone": TONES[event.event] ?? "" });
    row.replaceChildren(...content(event));
    return { key, row };
  }

  /** Announce the events since the last update; older ones are not announced. */
  announce(notable, names) {
    const news = notable.map((event, k) => [event, names[k]]).filter(([event, name]) => event.at > this.latest && event.at - (this.spokenAt.get(name) ?? -Infinity) > REPEAT_SECONDS);
    for (const [event, name] of news) this.spokenAt.set(name, event.at);
    const lines = news.slice(0, ANNOUNCED).reverse().map(([event]) => spoken(event));
    if (news.length > ANNOUNCED) lines.unshift(`${news.length - ANNOUNCED} more warnings and refusals, and then:`);
    this.log.append(...lines.map((text) => element("p", { text })));
    while (this.log.children.length > LOG_LINES) this.log.firstChild.remove();
  }
}
