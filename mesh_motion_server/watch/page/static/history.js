// The charts of a session; thinned to the screen's resolution, or the latest ones, each of them.

import { ask } from "./live.js";
import { Chart } from "./charts.js";
import { byId, quality, seconds } from "./format.js";

/** Number of requested points: about two per pixel of a wide screen, one of them the minimum of its neighbours. */
const POINTS = 1500;
const LATEST = 100;

const QUALITY = [
  { name: "actual_min", label: "minimum", colour: "--minimum", width: 1.9 },
  { name: "actual_p1", label: "1 %", colour: "--p1" },
  { name: "actual_p50", label: "median", colour: "--p50" },
  { name: "predicted_min", label: "predicted minimum", colour: "--predicted", dash: [5, 3], width: 1.6 },
];

const versioned = (session) => `${session.session} ${session.version} ${session.whole}`;

const last = (values) => values?.[values.length - 1] ?? null;

function least(columns, name) {
  const values = columns[name] ?? [];
  let place = -1;
  for (let k = 0; k < values.length; k++) if (values[k] !== null && (place < 0 || values[k] < values[place])) place = k;
  return place;
}

export class History {
  /** failed(error): the steps cannot be loaded. */
  constructor(failed) {
    this.failed = failed;
    this.loaded = "";
    this.session = null;
    this.latest = false;
    this.columns = { step: [] };
    this.quality = new Chart(byId("quality"), {
      title: "Quality over steps",
      height: 236,
      series: QUALITY,
      range: (_, low, high) => this.qualityRange(low, high),
      value: quality,
      tick: (value) => value.toFixed(value === Math.round(10 * value) / 10 ? 1 : 2),
      threshold: () => this.session?.threshold,
      describe: (columns) => this.describeQuality(columns),
    });
    this.iterations = new Chart(byId("iterations"), {
      title: "Coupling iterations a step",
      height: 104,
      stepped: true,
      series: [
        { name: "iterations", label: "iterations", colour: "--p1" },
        { name: "refusals", label: "refusals", colour: "--threshold" },
      ],
      range: (_, low, high) => [0, Math.max(4, Math.ceil(1.1 * (high ?? 1)))],
      increments: [1, 2, 5, 10, 20, 50, 100],
      value: (value) => (value === null || value === undefined ? "–" : String(value)),
      describe: (columns) => `Coupling iterations a step, last ${last(columns.iterations) ?? "none"}. Arrow keys read single steps.`,
    });
    this.seconds = new Chart(byId("seconds"), {
      title: "Time of a step",
      height: 104,
      stepped: true,
      series: [{ name: "seconds_total", label: "all iterations", colour: "--p1" }],
      range: (_, low, high) => [0, high > 0 ? 1.05 * high : 1],
      value: seconds,
      tick: (value) => Number(value.toPrecision(3)).toString(),
      describe: (columns) => `Time of a step, last ${seconds(last(columns.seconds_total))}. Arrow keys read single steps.`,
    });
    this.charts = [this.quality, this.iterations, this.seconds];
    byId("all-steps").addEventListener("click", () => this.turn(false));
    byId("latest-steps").addEventListener("click", () => this.turn(true));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.charts.forEach((chart) => chart.build()));
  }

  qualityRange(low, high) {
    const least = Math.min(0, low ?? 0, this.session?.threshold ?? 0);
    return [least < 0 ? Math.floor(10 * least) / 10 : 0, Math.max(1, high ?? 1)];
  }

  describeQuality(columns) {
    const place = least(columns, "actual_min");
    if (place < 0) return "Quality over steps: nothing committed yet";
    return (
      `Quality over steps 0 to ${last(columns.step)}: minimum now ${quality(last(columns.actual_min))}, lowest ` +
      `${quality(columns.actual_min[place])} at step ${columns.step[place]}, threshold ${this.session?.threshold}. Arrow keys read single steps.`
    );
  }

  /** Show another session, or news of this one; changed series are fetched. */
  async follow(session) {
    if (session.session !== this.session?.session) this.latest = false;
    this.session = session;
    if (versioned(session) !== this.loaded) await this.load();
  }

  /** Show the latest steps, or all. */
  async turn(latest) {
    this.latest = latest;
    if (this.session) await this.load().catch((error) => this.failed(error));
  }

  /** At most one request at a time; changes in the meantime are requested after it. */
  async load() {
    if (this.loading) {
      this.again = true;
      return;
    }
    this.loading = true;
    try {
      do {
        this.again = false;
        await this.fetch();
      } while (this.again);
    } catch (error) {
      this.loaded = "";
      throw error;
    } finally {
      this.loading = false;
    }
  }

  async fetch() {
    const { session } = this.session;
    const asking = versioned(this.session);
    const asked = new URLSearchParams({ points: POINTS });
    if (this.latest) asked.set("first", Math.max(0, this.session.step - LATEST, (last(this.columns.step) ?? 0) - LATEST));
    const reply = await ask(`api/sessions/${session}/series?${asked}`);
    const { columns } = await reply.json();
    if (session !== this.session.session) return;
    this.columns = columns;
    this.loaded = asking;
    for (const chart of this.charts) chart.show(columns);
    byId("all-steps").setAttribute("aria-pressed", !this.latest);
    byId("latest-steps").setAttribute("aria-pressed", this.latest);
  }
}
