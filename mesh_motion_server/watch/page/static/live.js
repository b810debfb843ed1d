// The connection to the server: server-sent events, which reconnect, and a message if nothing arrives for too long.

const SILENT_SECONDS = 15;
const RETRY_SECONDS = 2;

export class Live {
  /** hear(sessions): for each list; standing(gone, since, why): when the connection is lost or restored. */
  constructor(hear, standing) {
    this.hear = hear;
    this.standing = standing;
    this.last = Date.now();
    this.gone = false;
    if (!document.hidden) this.connect();
    setInterval(() => this.watch(), 1000);
    document.addEventListener("visibilitychange", () => this.turn());
  }

  connect() {
    this.source?.close();
    this.source = new EventSource("api/live");
    this.source.addEventListener("sessions", (event) => {
      this.alive();
      this.hear(JSON.parse(event.data));
    });
    this.source.addEventListener("beat", () => this.alive());
    this.source.onerror = () => this.fell();
    this.tried = Date.now();
  }

  /** A page in the background is not connected: a browser allows only six connections to one server, and each costs reading. */
  turn() {
    if (document.hidden) this.source?.close();
    else if (!this.source || this.source.readyState === EventSource.CLOSED) {
      if (!this.gone) this.last = Date.now();
      this.connect();
    }
  }

  alive() {
    this.last = Date.now();
    if (this.gone) {
      this.gone = false;
      this.standing(false, this.last);
    }
  }

  fell() {
    if (!this.gone) {
      this.gone = true;
      this.standing(true, this.last, "");
      if (this.source.readyState === EventSource.CLOSED) this.why();
    }
  }

  /** The connection was refused, not lost: a stream gives no reason, so ask with another request. */
  async why() {
    const reply = await fetch("api/live", { method: "HEAD", cache: "no-store" }).catch(() => null);
    if (reply?.status === 503 && this.gone) this.standing(true, this.last, "too many pages listen");
  }

  watch() {
    if (document.hidden) return;
    const now = Date.now();
    if (now - this.last > 1000 * SILENT_SECONDS) this.fell();
    // a browser reconnects by itself, but stops after some refusals; do not disturb a connection in progress
    const pause = this.source.readyState === EventSource.CLOSED ? RETRY_SECONDS : SILENT_SECONDS;
    if (this.gone && now - this.tried > 1000 * pause) this.connect();
  }
}

export async function ask(path) {
  const reply = await fetch(path, { cache: "no-store" });
  if (!reply.ok) {
    const said = await reply.json().catch(() => ({}));
    throw Object.assign(new Error(said.message ?? `the server answered ${reply.status}`), { status: reply.status });
  }
  return reply;
}
