// Controls the page: shows each new list, and fetches what has changed in the chosen session.

import { Absent, linked } from "./absent.js";
import { Live, ask } from "./live.js";
import { List } from "./list.js";
import { History } from "./history.js";
import { MeshPanel } from "./mesh_panel.js";
import { Events } from "./events.js";
import { showFaces, showWorst } from "./tables.js";
import { byId, clock, duration, element, plural, quality, seconds, short, whole, write } from "./format.js";

const PAUSE_SECONDS = 2;
/** Interval of requests while the server reads a history. */
const READING_SECONDS = 0.5;
/** Time after which a failed request is repeated. */
const RETRY_SECONDS = 5;

const TONES = ["bad", "warn", "good", ""];

/** The session that needs a look first: the worst state, of those alike the lowest minimum. */
const worst = (sessions) =>
  sessions.toSorted((a, b) => TONES.indexOf(a.verdict.tone) - TONES.indexOf(b.verdict.tone) || (a.minimum ?? 1) - (b.minimum ?? 1))[0];

class Page {
  constructor() {
    this.sessions = [];
    this.chosen = linked();
    this.absent = new Absent((session) => this.choose(session));
    this.list = new List((session) => this.choose(session), (session) => this.verdictOf(session));
    this.gone = 0; // Unix time since when the server does not answer
    this.history = new History((error) => this.failed(error));
    this.mesh = new MeshPanel();
    this.events = new Events();
    this.live = new Live((news) => this.take(news), (...said) => this.standing(...said));
    addEventListener("hashchange", () => linked() && linked() !== this.chosen && this.choose(linked()));
    document.addEventListener("visibilitychange", () => !document.hidden && this.update());
    setInterval(() => this.tick(), 1000);
  }

  take({ at, build, missing, sessions }) {
    this.offset = at - Date.now() / 1000;
    this.sessions = sessions;
    byId("build").textContent = `server ${build.version}, protocol ${build.protocol}`;
    const said = byId("connection");
    said.dataset.state = "live";
    write(said, missing ? `live; ${missing}` : "live");
    // users would confuse another session in its place with the chosen one
    this.chosen ||= worst(sessions)?.session ?? "";
    this.known = this.session ?? this.known;
    byId("nothing").hidden = this.chosen !== "";
    write(byId("nothing"), "Waiting for the first session …");
    this.show();
    this.update();
  }

  choose(session) {
    this.chosen = session;
    this.known = this.session ?? null;
    history.replaceState(null, "", `#${session}`);
    this.show();
    this.update();
  }

  /** Update the list and the tab's title. */
  show() {
    this.list.show(this.sessions, this.chosen);
    if (this.session) this.head(this.session);
  }

  /** The state of a session: {kind, tone, why, since}. */
  verdictOf(session) {
    return this.gone ? { kind: "server gone", tone: "bad", why: "this is the last known state", since: this.gone } : session.verdict;
  }

  standing(gone, since, why) {
    const said = byId("connection");
    const bar = byId("gone");
    this.gone = gone ? since / 1000 : 0;
    this.show();
    said.dataset.state = gone ? "gone" : "live";
    write(said, gone ? "gone" : "live");
    bar.hidden = !gone;
    const what = why ? `The server refuses this page: ${why}` : `The server is gone since ${clock(since / 1000)}`;
    bar.textContent = gone ? `${what}. What is shown is as it was then; the page goes on when it is back.` : "";
    if (!gone) this.update(true);
  }

  get session() {
    return this.sessions.find((session) => session.session === this.chosen);
  }

  /** One update at a time; later changes follow after it. A page in the background sends no requests. */
  async update(again = false) {
    if (this.updating || document.hidden) {
      this.behind = true;
      return;
    }
    this.updating = true;
    try {
      do {
        this.behind = false;
        await this.look(again);
        again = false;
      } while (this.behind);
    } catch (error) {
      this.failed(error);
    } finally {
      this.updating = false;
    }
  }

  /** Show the error in its own line, and repeat all requests. */
  failed(error) {
    this.key = "";
    byId("trouble").textContent = error.message;
    byId("trouble").hidden = false;
    this.again(1000 * RETRY_SECONDS);
  }

  again(pause) {
    this.later ??= setTimeout(() => {
      this.later = null;
      this.update();
    }, pause);
  }

  async look(again) {
    const { session } = this;
    byId("chosen").hidden = !this.known;
    if (!session) return this.without(this.chosen);
    this.absent.leave();
    this.head(session);
    const key = `${session.session} ${session.version}`;
    if (key === this.key && !again) return;
    if (!again && this.key?.startsWith(session.session) && this.tooSoon()) return;
    const detail = await (await ask(`api/sessions/${session.session}`)).json();
    if (session.session !== this.chosen) return (this.behind = true);
    this.detail = detail;
    this.detailed = session.session;
    this.figures(session, detail);
    byId("quality-metric").textContent = detail.built.settings?.quality_metric ?? "";
    const threshold = session.threshold ?? detail.built.settings?.quality_threshold ?? null;
    showWorst(detail.worst, threshold);
    showFaces(detail.faces, detail.ahead, detail.moved.step);
    this.events.show(session.session, detail.notable, detail.counted);
    this.mesh.follow(session);
    const { read } = detail;
    byId("reading").hidden = read === 1;
    byId("reading").textContent = read === 1 ? "" : `Reading a long history: ${Math.round(100 * read)} %. Until then its latest steps are shown.`;
    await this.history.follow({ ...session, threshold, whole: read === 1 });
    this.key = read === 1 ? key : "";
    if (read < 1) this.again(1000 * READING_SECONDS);
    byId("trouble").textContent = "";
    byId("trouble").hidden = true;
  }

  /** The data of a session that is not (or no longer) in the list stay visible. */
  without(chosen) {
    if (!chosen) return;
    const known = this.known && this.detailed === chosen ? { ...this.known, step: this.stepOf(this.known, this.detail), minimum: this.detail.actual.min ?? null } : this.known;
    this.absent.explain(chosen, known, this.sessions);
    byId("trouble").hidden = true;
    this.key = ""; // it may come back
    this.mesh.leave();
    if (this.known) this.say({ kind: "not listed", tone: "warn", why: "", since: 0 }, this.known);
  }

  /** A session with many steps per second is updated every two seconds. */
  tooSoon() {
    const left = 1000 * PAUSE_SECONDS - (performance.now() - (this.looked ?? -Infinity)); // no jump of the clock delays it
    if (left <= 0) {
      this.looked = performance.now();
      return false;
    }
    this.again(left);
    return true;
  }

  head(session) {
    this.say(this.verdictOf(session), session);
    this.about(session);
  }

  /** Show the state first: in a line of the page and in the tab's title. */
  say({ kind, tone, why, since, ends_at: end }, session) {
    const name = session.label || `session ${short(session.session)}`;
    const passed = since ? duration(this.now() - since) : "";
    write(byId("label"), name);
    byId("verdict").dataset.tone = tone;
    write(byId("state"), kind);
    write(byId("since"), passed && kind !== "running" ? `for ${passed}${why ? ":" : ""}` : "");
    write(byId("why"), end ? `${why}, ends about ${clock(end).slice(0, -3)}` : why);
    document.title = `${kind} · ${name} · step ${session.minimum_of} · mesh-motion`;
  }

  /** Unix time by the server's clock. */
  now() {
    return Date.now() / 1000 + (this.offset ?? 0);
  }

  about(session) {
    const built = this.detailed === session.session ? this.detail.built : null;
    const cells = built?.cells ? Object.entries(built.cells).map(([type, count]) => plural(count, type)) : [];
    const { committed_at: at, hourly } = session;
    const parts = [
      short(session.session),
      session.dimension ? `${session.dimension}D` : "",
      built?.nodes ? `${whole(built.nodes)} nodes` : "",
      ...cells,
      session.partitions > 1 ? `${session.partitions} partitions` : "",
      session.durability ? `durability ${session.durability}` : "",
      at ? `last commit ${duration(this.now() - at)} ago` : "",
      hourly ? `${whole(hourly)} steps an hour` : "",
    ];
    byId("about").textContent = parts.filter(Boolean).join(" · ") + (session.built && !session.recorded ? " · no history is kept (history_bytes = 0)" : "");
  }

  figures(session, detail) {
    const threshold = session.threshold ?? detail.built.settings?.quality_threshold;
    const low = (value) => (value !== undefined && value !== null && value < threshold ? "bad" : "");
    const { actual, corrected, standard, moved } = detail;
    const correction = moved.correction ?? {};
    const tiles = [
      ["step", whole(this.stepOf(session, detail)), this.stepNote(session, detail.open_refusals)],
      ["minimum", quality(actual.min), "committed", low(actual.min)],
      ["1 %", quality(actual.p1), "committed", low(actual.p1)],
      ["predicted", quality(corrected.min), standard.min !== undefined && standard.min !== corrected.min ? `${quality(standard.min)} uncorrected` : "", low(corrected.min)],
      ["correction", correction.method ?? "–", correction.enrichment_points ? plural(correction.enrichment_points, "point") : correction.freed_nodes ? plural(correction.freed_nodes, "node") : ""],
      ["last move", seconds(moved.seconds_total), moved.iteration ? `iteration ${moved.iteration}` : ""],
    ];
    const made = ([name, value, note, mark]) => element("div", { "data-tone": mark ?? "" }, element("dt", { text: name }), element("dd", { text: value }, note ? element("small", { text: ` ${note}` }) : ""));
    byId("figures").replaceChildren(...tiles.map(made));
  }

  /** The end of the run, if its client sends it, and the trial. */
  stepNote({ step, final_step: end, iteration }, refusals) {
    return [end >= Math.max(step, 1) ? `of ${whole(end)}` : "", iteration ? `trial ${iteration}` : "", refusals ? `next ${plural(refusals, "time")} refused` : ""].filter(Boolean).join(", ");
  }

  /** The step of the qualities shown, or a slightly older one; a session without a process may have lost steps in a crash. */
  stepOf(session, detail) {
    return session.worker === "alive" && detail.step ? detail.step : session.step;
  }

  tick() {
    if (this.session) this.head(this.session);
  }
}

globalThis.monitor = new Page();
