// The picture of the mesh: fetched while it is visible, at most every few seconds.

import { ask } from "./live.js";
import { byId, write } from "./format.js";

const SECONDS = 3;
/** Pause as a multiple of the time of the transfer, and its maximum: a slow connection is not overloaded. */
const [REST, LONGEST_SECONDS] = [9, 60];
/** Time after which a failed request is repeated. */
const RETRY_SECONDS = 15;

/** An address of the bytes that the page's policy permits for images. */
const addressOf = (blob) =>
  new Promise((done) => {
    const reader = new FileReader();
    reader.onload = () => done(reader.result);
    reader.readAsDataURL(blob);
  });

export class MeshPanel {
  constructor() {
    this.picture = byId("mesh");
    this.session = null;
    this.seen = true;
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => this.renew());
    new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      this.refresh();
    }).observe(this.picture.parentElement);
  }

  /** Show another session, or news of this one. */
  follow(session) {
    if (session.session !== this.session?.session) {
      this.picture.hidden = true;
      this.note("Drawing the mesh …");
      if (this.waiting) this.goOn();
    }
    this.session = session;
    this.renew();
  }

  renew() {
    this.stale = true;
    this.refresh();
  }

  /** The session will send no more meshes. */
  leave() {
    this.stale = false;
  }

  async refresh() {
    if (!this.session || !this.stale || !this.seen || document.hidden || this.loading) return;
    if (!this.session.built) return this.note("No mesh yet.");
    this.loading = true;
    this.stale = false;
    let pause = SECONDS;
    const { session } = this.session;
    try {
      const reply = await ask(`api/sessions/${session}/mesh.png${this.dark.matches ? "?dark" : ""}`);
      const begun = performance.now(); // of the transfer: the server has a pace of its own for drawing
      const address = await addressOf(await reply.blob());
      if (session === this.session.session) this.show(address);
      pause = Math.min(LONGEST_SECONDS, Math.max(SECONDS, (REST * (performance.now() - begun)) / 1000));
      const newer = Number(reply.headers.get("retry-after") ?? 0); // what came was drawn before
      this.stale ||= newer > 0;
      pause = Math.max(pause, newer);
    } catch (error) {
      if (session === this.session.session) this.note(error.status === 404 && !this.picture.hidden ? "" : error.message); // the page itself reports a discarded session
      pause = RETRY_SECONDS;
      this.stale ||= ![400, 404].includes(error.status); // these errors would occur again
    }
    this.waiting = setTimeout(
      () => {
        this.goOn();
        this.refresh();
      },
      1000 * (session === this.session.session ? pause : 0),
    );
  }

  /** The pause is over. */
  goOn() {
    clearTimeout(this.waiting);
    this.waiting = null;
    this.loading = false;
  }

  show(address) {
    this.picture.src = address;
    this.picture.hidden = false;
    this.note("");
  }

  note(text) {
    write(byId("mesh-note"), text);
    byId("mesh-note").hidden = !text;
  }
}
