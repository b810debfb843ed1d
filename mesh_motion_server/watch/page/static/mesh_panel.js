// The mesh and its tools: fetched while it is visible, at most every few seconds; a click on a cell shows its name.

import { ask } from "./live.js";
import { Camera } from "./camera.js";
import { centresDrawn, numberDrawn, worstDrawn } from "./mesh_cells.js";
import { paintScale } from "./colours.js";
import { byId, coordinates, plural, quality, whole, write } from "./format.js";

const SECONDS = 3;
/** Pause as a multiple of the time to load and draw, and its maximum: a slow connection or browser is not overloaded. */
const [REST, LONGEST_SECONDS] = [9, 60];
/** Time after which a failed request is repeated. */
const RETRY_SECONDS = 15;
/** Pixels of the view's height. */
const [SMALLEST, LARGEST] = [240, 430];
const VIEWS = { f4: Float32Array, u4: Uint32Array, u1: Uint8Array };

/** Unpack a view from drawing.py; unchanged parts come from the previous view. */
function unpack(buffer, before) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = header.arrays.map(([name, type, offset, size]) => [name, new VIEWS[type](buffer, 4 + length + offset, size)]);
  return { ...(before?.key === header.key ? before : {}), ...header, ...Object.fromEntries(arrays) };
}

export class MeshPanel {
  constructor() {
    this.canvas = byId("mesh");
    this.session = null;
    this.mesh = null;
    this.seen = true;
    this.worst = [];
    this.inside = true;
    this.edges = true;
    this.camera = new Camera(this.canvas, () => this.draw(), (x, y) => this.pick(x, y));
    paintScale(byId("scale"));
    this.listen();
    this.ready = import("./mesh_scene.js")
      .then(({ Scene }) => (this.scene = new Scene(this.canvas)))
      .catch((error) => {
        this.cannot = `This browser cannot draw the mesh (WebGL 2): ${error.message}. The worst cells are listed below.`;
        this.note(this.cannot);
      });
  }

  listen() {
    const pressed = (id, act) => byId(id).addEventListener("click", act);
    pressed("mesh-fit", () => this.fit());
    pressed("mesh-worst", () => this.goToWorst());
    pressed("mesh-edges", () => this.toggle("edges"));
    pressed("mesh-inside", () => this.toggle("inside"));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => {
      this.size();
      this.draw();
    }).observe(this.canvas);
    new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      if (this.seen) this.refresh();
    }).observe(this.canvas);
    this.canvas.addEventListener("webglcontextrestored", () => this.draw());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.scene?.recolour();
      this.draw();
    });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const ours = { w: () => this.goToWorst(), e: () => this.toggle("edges"), i: () => this.toggle("inside") }[event.key.toLowerCase()];
    if (ours) ours();
    else if (event.key === "0") this.fit();
    else if (!this.camera.key(event)) return;
    event.preventDefault();
  }

  toggle(what) {
    this[what] = !this[what];
    byId(`mesh-${what}`).setAttribute("aria-pressed", this[what]);
    if (what === "inside" && this.mesh) this.show(this.mesh);
    this.draw();
  }

  /** Show another session, or news of this one from its detail; past: the step that the rest of the page shows, null: the latest. */
  follow(session, detail, past) {
    if (session.session !== this.session?.session) {
      this.mesh = null;
      this.fresh = true;
      this.said("");
      this.clear();
      if (this.waiting) this.goOn();
    }
    this.session = session;
    this.how = past === null ? null : { past, command: `mesh-motion play --from-journal '${detail.folder}' --until ${past}` };
    if (this.mesh) this.note(this.whatIsShown(this.mesh));
    this.enrichment = detail.enrichment_points ?? [];
    this.worst = detail.standing; // a trial's prediction belongs to other coordinates than the drawn ones
    this.stale = true;
    this.marks();
    this.refresh();
  }

  /** The session will send no more meshes. */
  leave() {
    this.stale = false;
  }

  clear() {
    byId("mesh-step").textContent = "";
    this.note(this.cannot ?? "Reading the mesh …");
    this.scene?.show({ dimension: 2, points: new Float32Array(), quality: new Float32Array(), triangles: [], owners: [], inner: [], edges: [], outline: [], threshold: 0 }, false);
    for (const marks of this.scene ? [this.scene.worst, this.scene.enrichment] : []) this.scene.mark(marks, []);
    this.draw();
  }

  async refresh() {
    await this.ready;
    if (!this.scene || !this.session || !this.stale || !this.seen || document.hidden || this.loading) return;
    if (!this.session.built) return this.note("No mesh yet.");
    this.loading = true;
    this.stale = false;
    let pause = SECONDS;
    const { session } = this.session;
    const begun = performance.now();
    const before = this.mesh; // has the parts that the answer leaves out, even if the user changes the session in the meantime
    try {
      const reply = await ask(`api/sessions/${session}/mesh?have=${before?.key ?? ""}&seen=${before?.stamp ?? ""}`);
      const mesh = unpack(await reply.arrayBuffer(), before);
      if (session === this.session.session) this.take(mesh);
      pause = Math.min(LONGEST_SECONDS, Math.max(SECONDS, (REST * (performance.now() - begun)) / 1000));
    } catch (error) {
      this.note(error.status === 404 && this.mesh ? "" : error.message); // the page itself reports a discarded session
      pause = RETRY_SECONDS;
      this.stale = ![400, 404].includes(error.status); // these errors would occur again
    }
    this.waiting = setTimeout(() => {
      this.goOn();
      this.refresh();
    }, 1000 * (session === this.session.session ? pause : 0));
  }

  /** The pause is over. */
  goOn() {
    clearTimeout(this.waiting);
    this.waiting = null;
    this.loading = false;
  }

  take(mesh) {
    const isDrawn = mesh.key === this.mesh?.key && mesh.stamp === this.mesh.stamp;
    this.mesh = mesh;
    if (mesh.committed < this.session.step) this.stale = true; // a recent answer for another reader
    this.note(this.whatIsShown(mesh));
    byId("mesh-inside").hidden = mesh.dimension < 3;
    byId("threshold-mark").style.left = `${100 * Math.min(1, Math.max(0, mesh.threshold))}%`;
    byId("mesh-step").textContent = `step ${mesh.step}, minimum ${quality(mesh.minimum)}`;
    if (!isDrawn) this.show(mesh);
    if (this.fresh) this.fit();
    this.fresh = false;
    this.describe(mesh);
  }

  show(mesh) {
    this.scene.spacing = spacing(mesh);
    this.scene.show(mesh, this.inside);
    this.lowest = centresDrawn(mesh, worstDrawn(mesh));
    this.marks();
    this.draw();
  }

  whatIsShown(mesh) {
    if (mesh.dimension === 1) return "A mesh on a line: see the worst cells.";
    const late = mesh.committed > mesh.step ? `Stored last: step ${mesh.step}; committed: ${mesh.committed}. ` : "";
    const part = mesh.whole ? "" : `${whole(mesh.shown)} of ${whole(mesh.cells)} cells: ${mesh.dimension === 3 ? "boundary and worst cells" : "around the worst"}. `;
    const { past, command } = this.how ?? {};
    return late + part + (command && past !== mesh.step ? `This is step ${mesh.step}; for the mesh of step ${past}: ${command}` : "");
  }

  describe(mesh) {
    const worst = this.worst[0];
    this.canvas.setAttribute(
      "aria-label",
      `Mesh at step ${mesh.step}: ${plural(mesh.cells, "cell")} in ${mesh.dimension}D coloured by ${mesh.metric}, ` +
        `${whole(mesh.below)} below the threshold ${mesh.threshold}, ${whole(mesh.inverted_cells)} inverted` +
        (worst ? `; worst ${worst.type} ${worst.cell} with ${quality(worst.metric)} at ${coordinates(worst.centre)}` : ""),
    );
  }

  /** Coordinates of the session in units of the view. */
  place(point) {
    const { centre, half } = this.mesh;
    return [0, 1, 2].map((k) => ((point[k] ?? 0) - (k < point.length ? centre[k] : 0)) / half);
  }

  marks() {
    const count = this.enrichment?.length ?? 0;
    byId("key-enrichment").hidden = count === 0;
    byId("enrichment-count").textContent = plural(count, "enrichment point");
    if (!this.mesh || !this.scene) return;
    this.scene.mark(this.scene.enrichment, this.enrichment.map((point) => this.place(point)));
    this.scene.mark(this.scene.worst, this.lowest);
    this.draw();
  }

  fit() {
    this.camera.flat = !this.mesh || this.mesh.dimension < 3;
    const reach = [0.05, 0.05];
    const points = this.mesh?.points ?? [];
    for (let k = 0; k < points.length; k += 3) {
      reach[0] = Math.max(reach[0], Math.abs(points[k]));
      reach[1] = Math.max(reach[1], Math.abs(points[k + 1]));
    }
    this.reach = reach;
    this.size();
    this.camera.fit(reach);
  }

  /** Set the height that the mesh needs at the available width. */
  size() {
    const { clientWidth: width } = this.canvas;
    const wanted = this.camera.flat && this.reach ? width * (this.reach[1] / this.reach[0]) * 1.15 : 0.85 * width;
    this.canvas.style.height = `${Math.round(Math.min(LARGEST, Math.max(SMALLEST, wanted)))}px`;
  }

  goToWorst() {
    if (this.worst.length) this.goTo(this.worst[0]);
  }

  goTo(cell) {
    if (!this.mesh) return;
    const [place] = [...centresDrawn(this.mesh, [numberDrawn(this.mesh, cell)]), this.place(cell.centre)];
    const size = Math.max(12 * this.spacingNear(place), 1e-4);
    this.camera.closeTo(place, Math.min(1, size));
    this.said(`${cell.type} ${cell.cell} of partition ${cell.partition}: ${quality(cell.metric)} at ${coordinates(cell.centre)}`);
  }

  /** Length of an edge near a place. */
  spacingNear(place) {
    const { points, edges } = this.mesh;
    let best = Infinity;
    let length = 0.05;
    for (let k = 0; k < edges.length; k += 2) {
      const [a, b] = [3 * edges[k], 3 * edges[k + 1]];
      const off = Math.hypot(points[a] - place[0], points[a + 1] - place[1], points[a + 2] - place[2]);
      if (off < best) {
        best = off;
        length = Math.hypot(points[a] - points[b], points[a + 1] - points[b + 1], points[a + 2] - points[b + 2]);
      }
    }
    return length;
  }

  /** The cell under a click: the first triangle that the ray meets. */
  pick(x, y) {
    if (!this.mesh?.owners) return;
    const hit = firstHit(this.mesh, this.camera.ray(x, y), this.inside);
    this.scene.choose(this.mesh, hit);
    this.draw();
    if (hit === null) return this.said("No cell there.");
    const { types, kind, partition, local } = this.mesh;
    this.said(`${types[kind[hit]]} ${local[hit]} of partition ${partition[hit]}: ${quality(this.mesh.quality[hit])}${this.mesh.inverted[hit] ? ", inverted" : ""}`);
  }

  said(text) {
    write(byId("mesh-said"), text);
  }

  note(text) {
    const note = byId("mesh-note");
    note.textContent = text;
    note.hidden = !text;
  }

  draw() {
    if (!this.scene || this.drawing) return;
    this.drawing = requestAnimationFrame(() => {
      this.drawing = 0;
      this.scene.draw(this.camera, this.edges);
    });
  }
}

/** Typical length of an edge, from some of them. */
function spacing({ points, edges }) {
  const lengths = [];
  const stride = 2 * Math.max(1, Math.floor(edges.length / 4000));
  for (let k = 0; k + 1 < edges.length; k += stride) {
    const [a, b] = [3 * edges[k], 3 * edges[k + 1]];
    lengths.push(Math.hypot(points[a] - points[b], points[a + 1] - points[b + 1], points[a + 2] - points[b + 2]));
  }
  return lengths.sort((a, b) => a - b)[lengths.length >> 1] ?? 0.1;
}

/** Möller and Trumbore's test of each triangle; the cell of the nearest hit, or null. */
function firstHit(mesh, { origin, direction: d }, inside) {
  const { triangles, owners, points, quality } = mesh;
  let nearest = Infinity;
  let found = null;
  for (let t = 0; t < owners.length; t++) {
    if (owners[t] >= quality.length) continue;
    const [a, b, c] = [3 * triangles[3 * t], 3 * triangles[3 * t + 1], 3 * triangles[3 * t + 2]];
    const [ux, uy, uz] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const [vx, vy, vz] = [points[c] - points[a], points[c + 1] - points[a + 1], points[c + 2] - points[a + 2]];
    const [px, py, pz] = [d[1] * vz - d[2] * vy, d[2] * vx - d[0] * vz, d[0] * vy - d[1] * vx];
    const det = ux * px + uy * py + uz * pz;
    if (Math.abs(det) < 1e-30 || (mesh.dimension === 3 && inside && !mesh.inner[t] && det > 0)) continue;
    const [sx, sy, sz] = [origin[0] - points[a], origin[1] - points[a + 1], origin[2] - points[a + 2]];
    const u = (sx * px + sy * py + sz * pz) / det;
    if (u < 0 || u > 1) continue;
    const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
    const v = (d[0] * qx + d[1] * qy + d[2] * qz) / det;
    if (v < 0 || u + v > 1) continue;
    const far = (vx * qx + vy * qy + vz * qz) / det;
    if (far < nearest) [nearest, found] = [far, owners[t]];
  }
  return found;
}
