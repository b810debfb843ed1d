// The list of sessions: a listbox with arrow-key navigation.

import { arrange, byId, drawing, element, quality, short, write } from "./format.js";

const SPARK = { width: 64, height: 18 };

/** The minimum of the latest steps as a line in 0 … 1, with the threshold. */
function spark(values, threshold) {
  const { width, height } = SPARK;
  const all = [...values, threshold].filter((value) => value !== null);
  const [low, high] = [Math.min(...all) - 0.03, Math.max(...all) + 0.03];
  const y = (value) => (1 + ((height - 2) * (high - value)) / (high - low)).toFixed(1);
  const image = drawing("svg", { width, height, viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true" });
  if (threshold !== null) image.append(drawing("line", { class: "spark-threshold", x1: 0, x2: width, y1: y(threshold), y2: y(threshold) }));
  const known = values.map((value, k) => [k, value]).filter(([, value]) => value !== null);
  const x = (k) => (values.length > 1 ? (k * width) / (values.length - 1) : width).toFixed(1);
  if (known.length) image.append(drawing("polyline", { class: "spark", points: known.map(([k, value]) => `${x(k)},${y(value)}`).join(" ") }));
  return image;
}

export class List {
  /** choose(id): the user chooses a session; verdictOf(session): its state, {kind, tone, why, since}. */
  constructor(choose, verdictOf) {
    this.verdictOf = verdictOf;
    this.box = byId("sessions");
    this.choose = choose;
    this.sessions = [];
    this.chosen = "";
    this.drawn = new Map();
    this.box.addEventListener("keydown", (event) => this.key(event));
    this.box.addEventListener("click", (event) => {
      const row = event.target.closest("li");
      if (row) this.choose(row.dataset.session);
    });
  }

  key(event) {
    const place = this.sessions.findIndex((session) => session.session === this.chosen);
    const last = this.sessions.length - 1;
    const to = { ArrowDown: Math.min(last, place + 1), ArrowUp: Math.max(0, place - 1), Home: 0, End: last }[event.key];
    if (to === undefined || last < 0) return;
    event.preventDefault();
    this.choose(this.sessions[to].session);
    this.box.children[to]?.scrollIntoView({ block: "nearest" });
  }

  show(sessions, chosen) {
    this.sessions = this.inOrder(sessions);
    this.chosen = chosen;
    byId("sessions-count").textContent = sessions.length || "";
    byId("no-sessions").hidden = sessions.length > 0;
    this.box.hidden = sessions.length === 0;
    arrange(this.box, this.sessions.map((session) => this.row(session)));
    this.box.setAttribute("aria-activedescendant", chosen ? `s-${chosen}` : "");
    for (const known of this.drawn.keys()) if (!sessions.some((session) => session.session === known)) this.drawn.delete(known);
  }

  /** Sessions in use come first, the others keep their places: users miss rows that move. */
  inOrder(sessions) {
    const places = new Map(this.sessions.map((session, k) => [session.session, k]));
    const place = (session) => places.get(session.session) ?? -1; // new ones come first
    const rests = (session) => (session.worker === "none" ? 1 : 0);
    return sessions.toSorted((a, b) => rests(a) - rests(b) || place(a) - place(b));
  }

  /** A session's row; it stays the same element as long as the session is listed. */
  row(session) {
    const drawn = this.drawn.get(session.session) ?? this.made(session.session);
    const { row } = drawn;
    const selected = session.session === this.chosen;
    const alike = session.label && this.sessions.some((other) => other.label === session.label && other.session !== session.session);
    const verdict = this.verdictOf(session);
    const key = JSON.stringify([session, selected, alike, verdict]);
    if (drawn.key === key) return row;
    drawn.key = key;
    row.setAttribute("aria-selected", selected);
    row.className = selected ? "active" : "";
    const [name, state, at, line, why] = row.querySelectorAll("span");
    write(name, alike ? `${short(session.session)} ${session.label}` : session.label || short(session.session));
    name.title = `${session.label} ${session.session}`.trim();
    write(state, verdict.kind);
    state.dataset.tone = verdict.tone;
    write(at, session.built ? `step ${session.minimum_of} · min ${quality(session.minimum)}` : "");
    write(why, ["warn", "bad"].includes(verdict.tone) ? verdict.why : "");
    why.title = verdict.why;
    line.replaceChildren(spark(session.spark, session.threshold));
    return row;
  }

  made(session) {
    const row = element(
      "li",
      { id: `s-${session}`, role: "option", "data-session": session },
      element("div", { class: "row" }, element("span", { class: "name" }), element("span", { class: "badge" })),
      element("div", { class: "row second" }, element("span"), element("span", { class: "line" })),
      element("span", { class: "why" }),
    );
    const drawn = { row, key: "" };
    this.drawn.set(session, drawn);
    return drawn;
  }
}
