// A chosen session that is not in the list: it was discarded, is not opened yet, or is too old for the list.

import { ask } from "./live.js";
import { byId, clock, element, quality, short } from "./format.js";

const ID = /^[0-9a-f]{32}$/;

/** The session that a link names; nothing if the link names another part of the page. */
export const linked = () => (ID.test(location.hash.slice(1)) ? location.hash.slice(1) : "");

const called = (session) => (session.label ? `“${session.label}” (${short(session.session)})` : `Session ${short(session.session)}`);

/** Whether the server has a session, listed or not. */
async function has(session) {
  try {
    await ask(`api/sessions/${session}`);
    return true;
  } catch (error) {
    if (error.status !== 404) throw error;
    return false;
  }
}

export class Absent {
  /** choose(id) is called when the user accepts the offered session. */
  constructor(choose) {
    this.place = byId("ended");
    this.choose = choose;
    this.leave();
  }

  /** The chosen session exists. */
  leave() {
    this.found = "";
    this.place.replaceChildren();
  }

  /** Find the state of the session `chosen`, with one request. known: its last entry in the list, if any; false: no news. */
  async look(chosen, known, sessions) {
    if (this.found === chosen) return false;
    const there = await has(chosen);
    this.found = chosen;
    this.discarded = !there;
    const heir = known?.label && sessions.find((session) => session.label === known.label);
    this.say(known ? `${lost(known, there, sessions.length)}${heir ? "" : sessions.length ? " Choose another session." : ""}` : never(chosen, there, sessions.length));
    if (heir) {
      const button = element("button", { type: "button", text: `Show the other ${called(heir)}` });
      button.addEventListener("click", () => this.choose(heir.session));
      this.place.append(button);
    }
    return true;
  }

  say(text) {
    this.place.replaceChildren(element("p", { text }));
  }
}

function lost(known, there, listed) {
  const shown = `What is shown is of ${clock(Date.now() / 1000)} or before.`;
  if (there) return `${called(known)} is not among the ${listed} sessions of the list, which are those that changed last. ${shown}`;
  const minimum = known.minimum === null ? "" : `, minimum ${quality(known.minimum)}`;
  return `${called(known)} was discarded: the server has it no more. Its last step here was ${known.step}${minimum}. ${shown}`;
}

function never(chosen, there, listed) {
  if (there) return `Session ${short(chosen)} is there, but not among the ${listed} sessions of the list, which are those that changed last.`;
  return `There is no session ${short(chosen)}: it was discarded, or is not open yet. It is shown as soon as it is there.${listed ? " Or choose another." : ""}`;
}
