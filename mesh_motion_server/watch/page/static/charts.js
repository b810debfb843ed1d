// One chart over steps: uPlot inside, around it a legend, keys, and a text description for screen readers.

import { css, drawing, element } from "./format.js";

// whole pixels: uPlot needs integers on high-density screens
const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const KEY_SHARE = 0.02;
/** Up to this number, steps are also drawn as points: a line through one step is invisible. */
const FEW = 40;

/**
 * series: [{name, label, colour (a custom property), width, dash}];
 * threshold: () => number; range: of y; value: number → text.
 */
export class Chart {
  constructor(host, options) {
    this.host = host;
    this.options = options;
    this.series = options.series;
    this.columns = { step: [] };
    this.legend = element("div", { class: "chart-legend" });
    this.frame = element("div", { class: "plot", tabindex: "0", role: "img", "aria-label": options.title });
    host.replaceChildren(this.legend, this.frame);
    this.frame.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.resize()).observe(host);
    this.build();
  }

  build() {
    const kept = this.plot ? [this.plot.scales.x.min, this.plot.scales.x.max] : null;
    this.plot?.destroy();
    this.plot = new uPlot(this.plotOptions(), this.data(), this.frame);
    this.drawLegend();
    if (kept && kept[0] !== null && this.columns.step.length) this.plot.setScale("x", { min: kept[0], max: kept[1] });
  }

  plotOptions() {
    const quiet = css("--quiet");
    const axis = { stroke: quiet, font: FONT, grid: { stroke: css("--line"), width: 1 }, ticks: { show: false } };
    return {
      width: Math.max(120, this.host.clientWidth),
      height: this.options.height,
      padding: [8, 10, 0, 0],
      legend: { show: false },
      cursor: { sync: { key: "steps" }, drag: { x: false, y: false }, points: { size: 6 }, y: false },
      scales: { x: { time: false }, y: { range: this.options.range } },
      axes: [
        { ...axis, size: 26, gap: 4, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5] },
        { ...axis, size: 46, gap: 4, space: 34, values: (_, ticks) => ticks.map(this.options.tick ?? String), incrs: this.options.increments },
      ],
      series: [{ label: "step" }, ...this.series.map((one) => this.line(one))],
      hooks: {
        drawClear: [(plot) => this.drawThreshold(plot)],
        setCursor: [() => this.say()],
      },
    };
  }

  line(one) {
    const stroke = css(one.colour);
    const common = { label: one.name, points: { show: false }, spanGaps: false };
    if (this.options.stepped) return { ...common, stroke, fill: `${stroke}40`, width: 1.4, paths: uPlot.paths.stepped({ align: -1 }) };
    return { ...common, stroke, width: one.width ?? 1.2, dash: one.dash, points: { show: () => this.columns.step.length <= FEW, size: 4 } };
  }

  show(columns) {
    this.columns = columns;
    this.plot.setData(this.data(), false);
    this.plot.setScale("x", this.whole());
    this.frame.setAttribute("aria-label", this.options.describe(columns));
    this.say();
  }

  whole() {
    const steps = this.columns.step;
    if (!steps.length) return { min: 0, max: 1 };
    const first = steps[0];
    const last = steps[steps.length - 1];
    return { min: first, max: Math.max(last, first + 1) };
  }

  data() {
    const columns = this.columns;
    const get = (one) => columns[one.name] ?? new Array(columns.step.length).fill(null);
    return [columns.step, ...this.series.map(get)];
  }

  drawThreshold(plot) {
    const threshold = this.options.threshold?.();
    if (threshold === undefined || threshold === null) return;
    const pen = plot.ctx;
    const y = plot.valToPos(threshold, "y", true);
    const { left, width, top, height } = plot.bbox;
    if (y < top || y > top + height) return;
    pen.save();
    pen.strokeStyle = css("--threshold");
    pen.lineWidth = devicePixelRatio;
    pen.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    pen.beginPath();
    pen.moveTo(left, y);
    pen.lineTo(left + width, y);
    pen.stroke();
    pen.fillStyle = css("--threshold");
    pen.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    pen.textAlign = "left";
    const [x, baseline] = [left + 6 * devicePixelRatio, y + 13 * devicePixelRatio];
    pen.fillText(`threshold ${threshold}`, x, baseline);
    pen.restore();
  }

  drawLegend() {
    const swatch = (one) => {
      const image = drawing("svg", { width: 14, height: 10, "aria-hidden": "true" });
      const shape = this.options.stepped
        ? drawing("rect", { width: 10, height: 10, x: 2, rx: 2, fill: css(one.colour) })
        : drawing("line", { x1: 0, x2: 14, y1: 5, y2: 5, stroke: css(one.colour), "stroke-width": Math.max(2, one.width ?? 1.5), "stroke-dasharray": one.dash ? "3 2" : "" });
      image.append(shape);
      return image;
    };
    this.values = new Map();
    this.at = element("span", { class: "at" });
    const keys = this.series.map((one) => {
      const value = element("span", { class: "value" });
      this.values.set(one.name, value);
      return element("span", { class: "key" }, swatch(one), one.label, value);
    });
    this.legend.replaceChildren(...keys, this.at);
    this.say();
  }

  /** The values under the cursor, or the last ones. */
  say() {
    const steps = this.columns.step;
    const under = this.plot?.cursor.idx;
    const k = under ?? steps.length - 1;
    if (!this.at || k < 0 || k >= steps.length) return;
    this.at.textContent = under === null || under === undefined ? "" : `step ${steps[k]}`;
    for (const [name, cell] of this.values) cell.textContent = this.options.value(this.columns[name]?.[k]);
  }

  resize() {
    const width = Math.max(120, this.host.clientWidth);
    if (this.plot && width !== this.plot.width) this.plot.setSize({ width, height: this.options.height });
  }

  key(event) {
    const steps = this.columns.step;
    if (!steps.length || event.ctrlKey || event.metaKey || event.altKey) return;
    const place = this.plot.cursor.idx ?? steps.length - 1;
    const leap = Math.max(1, Math.round((event.shiftKey ? 5 : 1) * KEY_SHARE * steps.length));
    const moves = { ArrowLeft: place - leap, ArrowRight: place + leap, Home: 0, End: steps.length - 1 };
    if (event.key in moves) this.point(Math.min(steps.length - 1, Math.max(0, moves[event.key])));
    else return;
    event.preventDefault();
  }

  point(k) {
    const step = this.columns.step[k];
    this.plot.setCursor({ left: this.plot.valToPos(step, "x"), top: 10 });
    this.frame.setAttribute("aria-label", `${this.options.title}, step ${step}: ${this.spoken(k)}`);
  }

  spoken(k) {
    return this.series.map((one) => `${one.label} ${this.options.value(this.columns[one.name]?.[k])}`).join(", ");
  }
}
