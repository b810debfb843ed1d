// The connection to the server: the list of sessions is asked for every second, and failures are shown.

const SECONDS = 1;
const SILENT_SECONDS = 15;

export class Live {
  /** take(list): for each list; standing(gone, since, why): when the connection is lost or restored. */
  constructor(take, standing) {
    this.take = take;
    this.standing = standing;
    this.last = Date.now();
    this.gone = false;
    document.addEventListener("visibilitychange", () => this.look());
    this.look();
  }

  /** One question at a time; a page in the background asks nothing. */
  async look() {
    clearTimeout(this.later);
    if (document.hidden || this.asking) return;
    this.asking = true;
    let list = null;
    try {
      list = await (await ask("api/sessions", { signal: AbortSignal.timeout(1000 * SILENT_SECONDS) })).json();
    } catch (error) {
      const why = error.status ? error.message : "";
      if (!this.gone || why !== this.why) this.turn(true, why);
    }
    this.asking = false;
    this.later = setTimeout(() => this.look(), 1000 * SECONDS);
    if (!list) return;
    this.last = Date.now();
    if (this.gone) this.turn(false, "");
    this.take(list);
  }

  /** why: what the server answered; empty without an answer. */
  turn(gone, why) {
    this.gone = gone;
    this.why = why;
    this.standing(gone, this.last, why);
  }
}

export async function ask(path, options = {}) {
  const reply = await fetch(path, { cache: "no-store", ...options });
  if (!reply.ok) {
    const said = await reply.json().catch(() => ({}));
    throw Object.assign(new Error(said.message ?? `the server answered ${reply.status}`), { status: reply.status });
  }
  return reply;
}
