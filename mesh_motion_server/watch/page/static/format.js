// Readable numbers and times, and elements made without markup: the names that clients send stay plain text.

export const quality = (value) => (value === null || value === undefined || Number.isNaN(value) ? "–" : value.toFixed(3));

export const whole = (value) => (value === null || value === undefined ? "–" : Math.round(value).toLocaleString("en").replaceAll(",", "\u202f"));

export function seconds(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value >= 100) return `${value.toFixed(0)} s`;
  if (value >= 1) return `${value.toFixed(value >= 10 ? 1 : 2)} s`;
  if (value >= 1e-3) return `${(1e3 * value).toFixed(value >= 0.1 ? 0 : 1)} ms`;
  return value === 0 ? "0" : `${(1e6 * value).toFixed(0)} µs`;
}

export const coordinates = (place) => place.map((x) => (x === null ? "–" : Number(x.toPrecision(4)).toString())).join(", ");

/** The time, and the date if it is not today. */
export function clock(at) {
  const when = new Date(1000 * at);
  const time = when.toLocaleTimeString("en-GB");
  return when.toDateString() === new Date().toDateString() ? time : `${when.toLocaleDateString("sv")} ${time}`;
}

/** A duration as readable text. */
export function duration(passed) {
  const [size, unit] = passed < 120 ? [1, "s"] : passed < 7200 ? [60, "min"] : passed < 172800 ? [3600, "h"] : [86400, "days"];
  return `${Math.max(0, passed / size).toFixed(0)} ${unit}`;
}

export const short = (session) => session.slice(0, 8);

export const plural = (count, word) => `${whole(count)} ${word}${count === 1 ? "" : "s"}`;

/** An element with attributes ("text" is its content) and children. */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null) continue;
    if (key === "text") made.textContent = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

export function drawing(name, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Set the children in this order; do not touch those already in place, so that a press, selection or focus in them stays. */
export function arrange(parent, children) {
  const wanted = new Set(children);
  for (const child of [...parent.children]) if (!wanted.has(child)) child.remove();
  children.forEach((child, k) => parent.children[k] !== child && parent.insertBefore(child, parent.children[k] ?? null));
}

/** Set the text only if it differs: a screen reader reads new text again. */
export function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

export const byId = (id) => document.getElementById(id);

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
