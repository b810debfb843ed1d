// A chosen session that is not in the list: it was discarded, is not opened yet, or others have changed later.

import { byId, clock, element, quality, short } from "./format.js";

const ID = /^[0-9a-f]{32}$/;

/** The session that a link names; nothing if the link names another part of the page. */
export const linked = () => (ID.test(location.hash.slice(1)) ? location.hash.slice(1) : "");

const called = (session) => (session.label ? `“${session.label}” (${short(session.session)})` : `Session ${short(session.session)}`);

export class Absent {
  /** choose(id) is called when the user accepts the offered session. */
  constructor(choose) {
    this.place = byId("ended");
    this.choose = choose;
  }

  /** The chosen session exists. */
  leave() {
    this.said = "";
    this.place.replaceChildren();
  }

  /** Say that the session `chosen` is absent, once. known: its last entry in the list, if any. */
  explain(chosen, known, sessions) {
    if (this.said === chosen) return;
    this.said = chosen;
    const heir = known?.label && sessions.find((session) => session.label === known.label);
    this.place.replaceChildren(element("p", { text: known ? lost(known) : `There is no session ${short(chosen)} in the list. It is shown as soon as it is there.` }));
    if (!heir) return;
    const button = element("button", { type: "button", text: `Show the other ${called(heir)}` });
    button.addEventListener("click", () => this.choose(heir.session));
    this.place.append(button);
  }
}

function lost(known) {
  const minimum = known.minimum === null ? "" : `, minimum ${quality(known.minimum)}`;
  return `${called(known)} was discarded, or others have changed later: it is not in the list any more. Its last step here was ${known.step}${minimum}. What is shown is of ${clock(Date.now() / 1000)} or before.`;
}
