// The mesh on the graphics card: cells coloured by quality, edges, outline, marks. Drawn only when something changed.

import * as three from "./vendor/three/three.module.min.js";
import { channels, table } from "./colours.js";
import { css } from "./format.js";

const CELLS = {
  vertexShader: `
    attribute float value;
    varying float quality;
    varying vec3 place;
    void main() {
      quality = value;
      place = position;
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    }`,
  fragmentShader: `
    uniform sampler2D colours;
    uniform vec3 inverted;
    uniform float lit;
    varying float quality;
    varying vec3 place;
    void main() {
      vec3 colour = quality < 0.0 ? inverted : texture2D(colours, vec2(quality * 0.996 + 0.002, 0.5)).rgb;
      if (lit > 0.0) {
        vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
        float light = abs(dot(normal, normalize(vec3(0.35, -0.45, 0.82))));
        colour *= 0.62 + 0.45 * light;
      }
      gl_FragColor = vec4(colour, 1.0);
    }`,
};

const MARKS = {
  vertexShader: `
    uniform float size;
    void main() {
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      gl_PointSize = size;
    }`,
  fragmentShader: `
    uniform vec3 colour;
    uniform vec3 rim;
    uniform float ring;
    void main() {
      vec2 at = 2.0 * gl_PointCoord - 1.0;
      float far = ring > 0.0 ? length(at) : abs(at.x) + abs(at.y);
      if (far > 1.0 || (ring > 0.0 && far < 0.52)) discard;
      bool edge = ring > 0.0 ? far > 0.86 || far < 0.62 : far > 0.66;
      gl_FragColor = vec4(edge ? rim : colour, 1.0);
    }`,
};

const colour = (name) => new three.Color().setRGB(...channels(css(name)), three.LinearSRGBColorSpace);

export class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new three.WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "low-power" });
    this.renderer.outputColorSpace = three.LinearSRGBColorSpace; // colours are already display colours
    this.camera = new three.OrthographicCamera(-1, 1, 1, -1, 0.01, 40);
    this.scene = new three.Scene();
    const map = new three.DataTexture(new Uint8Array(table()), 256, 1);
    map.minFilter = map.magFilter = three.LinearFilter;
    map.needsUpdate = true;
    const uniforms = { colours: { value: map }, inverted: { value: colour("--mesh-inverted") }, lit: { value: 0 } };
    const material = (side) => new three.ShaderMaterial({ ...CELLS, uniforms, side, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    this.uniforms = uniforms;
    this.walls = new three.Mesh(new three.BufferGeometry(), material(three.DoubleSide));
    this.inner = new three.Mesh(new three.BufferGeometry(), material(three.DoubleSide));
    this.edges = this.lines("--mesh-edge", 0.22);
    this.outline = this.lines("--mesh-outline", 0.9);
    this.below = this.lines("--mesh-below", 1);
    this.worst = this.points("--mesh-worst", 1, 14);
    this.enrichment = this.points("--mesh-point", 0, 11);
    this.chosen = this.lines("--mesh-outline", 1);
    this.scene.add(this.walls, this.inner, this.edges, this.outline, this.below, this.chosen, this.worst, this.enrichment);
    for (const child of this.scene.children) child.frustumCulled = false;
    [this.below, this.chosen, this.worst, this.enrichment].forEach((child, k) => {
      child.renderOrder = 3 + k;
      child.material.depthTest = false;
    });
    this.outline.renderOrder = 2;
    this.edges.renderOrder = 1;
  }

  lines(name, opacity) {
    const material = new three.LineBasicMaterial({ color: colour(name), transparent: opacity < 1, opacity });
    return Object.assign(new three.LineSegments(new three.BufferGeometry(), material), { userData: { name } });
  }

  points(name, ring, size) {
    const values = { colour: { value: colour(name) }, rim: { value: colour("--panel") }, ring: { value: ring }, size: { value: size * devicePixelRatio } };
    const material = new three.ShaderMaterial({ ...MARKS, uniforms: values, depthTest: false });
    return Object.assign(new three.Points(new three.BufferGeometry(), material), { userData: { name } });
  }

  recolour() {
    this.uniforms.inverted.value = colour("--mesh-inverted");
    for (const child of [this.edges, this.outline, this.below, this.chosen]) child.material.color = colour(child.userData.name);
    for (const child of [this.worst, this.enrichment]) {
      child.material.uniforms.colour.value = colour(child.userData.name);
      child.material.uniforms.rim.value = colour("--panel");
    }
  }

  /** mesh: header and arrays as received; see drawing.py. */
  show(mesh, inside) {
    const flat = mesh.dimension < 3;
    this.uniforms.lit.value = flat ? 0 : 1;
    this.fill(this.walls, mesh, 0);
    this.fill(this.inner, mesh, 1);
    // walls are seen from the fluid's side: walls in front of it are left out, bodies inside stay
    this.walls.material.side = flat || !inside ? three.DoubleSide : three.BackSide;
    this.place(this.edges, mesh, mesh.edges);
    this.place(this.outline, mesh, mesh.outline);
    this.place(this.below, mesh, this.around(mesh, (cell) => mesh.inverted[cell] || mesh.quality[cell] < mesh.threshold));
    this.chosen.geometry.deleteAttribute("position");
  }

  fill(body, mesh, inner) {
    const { triangles, owners, points, quality, inverted } = mesh;
    let count = 0;
    for (let t = 0; t < owners.length; t++) count += mesh.inner[t] === inner;
    const positions = new Float32Array(9 * count);
    const values = new Float32Array(3 * count);
    for (let t = 0, k = 0; t < owners.length; t++) {
      if (mesh.inner[t] !== inner) continue;
      // an inverted cell may have a quality of 0 or more: values below 0 are drawn as inverted
      const value = owners[t] >= quality.length ? 1 : inverted[owners[t]] ? -1 : quality[owners[t]];
      for (let c = 0; c < 3; c++, k++) {
        const node = 3 * triangles[3 * t + c];
        positions.set(points.subarray(node, node + 3), 3 * k);
        values[k] = value;
      }
    }
    body.geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
    body.geometry.setAttribute("value", new three.BufferAttribute(values, 1));
  }

  place(lines, mesh, nodes) {
    const positions = new Float32Array(3 * nodes.length);
    for (let k = 0; k < nodes.length; k++) positions.set(mesh.points.subarray(3 * nodes[k], 3 * nodes[k] + 3), 3 * k);
    lines.geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
  }

  /** Nodes of the edges around the requested cells: triangle edges that occur once. */
  around(mesh, wanted) {
    const seen = new Map();
    const base = mesh.points.length;
    for (let t = 0; t < mesh.owners.length; t++) {
      const cell = mesh.owners[t];
      if (cell >= mesh.quality.length || !wanted(cell) || (mesh.dimension === 3 && !mesh.inner[t])) continue;
      for (let c = 0; c < 3; c++) {
        const [a, b] = [mesh.triangles[3 * t + c], mesh.triangles[3 * t + ((c + 1) % 3)]];
        const key = `${cell}:${Math.min(a, b) * base + Math.max(a, b)}`;
        if (mesh.dimension < 3 && seen.has(key)) seen.delete(key);
        else seen.set(key, [a, b]);
      }
    }
    return Uint32Array.from([...seen.values()].flat());
  }

  mark(points, places) {
    points.geometry.setAttribute("position", new three.BufferAttribute(Float32Array.from(places.flat()), 3));
  }

  choose(mesh, cell) {
    this.place(this.chosen, mesh, cell === null ? [] : this.around({ ...mesh, inner: mesh.inner.fill ? mesh.inner.map(() => 1) : [] }, (one) => one === cell));
  }

  draw(view, edgesShown) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    if (this.canvas.width !== Math.round(width * devicePixelRatio) || this.canvas.height !== Math.round(height * devicePixelRatio)) {
      this.renderer.setPixelRatio(devicePixelRatio);
      this.renderer.setSize(width, height, false);
    }
    const half = view.half;
    const wide = (half * width) / height;
    Object.assign(this.camera, { left: -wide, right: wide, top: half, bottom: -half });
    const [, up, back] = view.axes();
    this.camera.position.set(...view.target.map((value, k) => value + 10 * back[k]));
    this.camera.up.set(...up);
    this.camera.lookAt(...view.target);
    this.camera.updateProjectionMatrix();
    // edges closer than a few pixels would only darken the cells
    const apart = this.spacing / view.pixel;
    this.edges.visible = edgesShown && apart > 2.5;
    this.edges.material.opacity = Math.min(0.55, 0.05 * apart);
    this.renderer.render(this.scene, this.camera);
  }
}
