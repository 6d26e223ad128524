(() => {
"use strict";
const D = JSON.parse(document.getElementById("data").textContent);
document.documentElement.classList.add("scripted");

// Numbers and small helpers -------------------------------------------------------------------------------------------
const minus = s => String(s).replace(/-/g, "\u2212");
const fixed = (v, n) => minus((Math.abs(v) < 0.5 * 10 ** -n ? 0 : v).toFixed(n));
const power = e => "10" + String(e).split("").map(c => "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"["-0123456789".indexOf(c)]).join("");
const clamp = (v, a, b) => Math.min(b, Math.max(a, v));
const short = v => { // four digits, and a power of ten where plain digits would need many zeros
  if (!Number.isFinite(v)) return "none";
  if (v === 0) return "0";
  const e = Math.floor(Math.log10(Math.abs(v)));
  return e < -4 || e > 6 ? `${minus((v / 10 ** e).toFixed(2))} \u00d7 ${power(e)}` : fixed(v, clamp(3 - e, 0, 7));
};
const unpack = p => { // 16-bit integers with offset and step; 0 is "no value"
  const raw = atob(p.b64), n = raw.length >> 1, out = new Float64Array(n);
  for (let i = 0; i < n; i++) { const k = raw.charCodeAt(2 * i) | raw.charCodeAt(2 * i + 1) << 8; out[i] = k ? p.low + (k - 1) * p.step : NaN; }
  return out;
};
const rgb = h => [parseInt(h.slice(1, 3), 16), parseInt(h.slice(3, 5), 16), parseInt(h.slice(5, 7), 16)];
const LUT = {}; // 256 colors of each map as ABGR words
for (const name in D.colors) {
  const stops = D.colors[name].map(rgb), out = LUT[name] = new Uint32Array(256);
  for (let i = 0; i < 256; i++) {
    const f = i / 255 * 63, a = Math.min(62, Math.floor(f)), t = f - a, c = k => Math.round(stops[a][k] * (1 - t) + stops[a + 1][k] * t);
    out[i] = 0xff000000 | c(2) << 16 | c(1) << 8 | c(0);
  }
}
const BELOW = 0xffd4cec9;
const nearest = (a, v) => { let lo = 0, hi = a.length - 1; while (hi - lo > 1) { const m = lo + hi >> 1; if (a[m] > v) hi = m; else lo = m; } return hi < 0 || v - a[lo] < a[hi] - v ? lo : hi; };
const escape = s => String(s).replace(/[&<>"]/g, c => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

function ticks(lo, hi, count) {
  if (!(hi > lo)) return [[lo, short(lo)]];
  const raw = (hi - lo) / count, mag = 10 ** Math.floor(Math.log10(raw)), unit = [1, 2, 2.5, 5, 10].find(u => u * mag >= raw * 0.999) * mag;
  const out = [], places = Math.max(0, -Math.floor(Math.log10(unit) + 1e-9) + (Math.abs(unit / mag - 2.5) < 1e-9 && mag <= 1 ? 1 : 0));
  const write = v => places > 6 || Math.abs(v) >= 1e7 ? short(v) : fixed(v, places);
  for (let k = Math.ceil(lo / unit - 1e-9); k * unit <= hi + 1e-9 * unit; k++) out.push([k * unit, write(k * unit)]);
  return out;
}
function decades(lo, hi) {
  const out = [], first = Math.ceil(Math.log10(lo) - 1e-9), last = Math.floor(Math.log10(hi) + 1e-9), every = Math.ceil((last - first + 1) / 9);
  for (let e = first; e <= last; e += every) out.push([10 ** e, e === 0 ? "1" : e === 1 ? "10" : power(e)]);
  return out.length > 1 ? out : ticks(lo, hi, 4);
}

// A plot: axes in SVG over an optional raster in a canvas; redrawn at the width of its panel, so text stays legible ----
const SVG = "http://www.w3.org/2000/svg";
const plots = [];
class Plot {
  constructor(id, options) {
    plots.push(this);
    this.id = id;
    this.host = document.querySelector(`[data-plot="${id}"]`);
    this.panel = this.host.closest(".panel");
    this.read = this.panel.querySelector(".readout");
    Object.assign(this, { left: 58, right: 14, top: 10, bottom: 42 }, options);
    if (this.raster) this.host.append(this.canvas = document.createElement("canvas"));
    this.svg = this.host.appendChild(document.createElementNS(SVG, "svg"));
    this.svg.setAttribute("aria-hidden", "true");
    this.panel.querySelector(".live").hidden = false;
    if (this.keys && this.keys.length) this.host.before(legend(this.keys));
    this.idle();
    this.host.addEventListener("pointermove", e => { if (!this.held) this.point(e); });
    this.host.addEventListener("pointerleave", () => this.idle());
    this.host.addEventListener("blur", () => this.idle());
    this.host.addEventListener("keydown", e => this.key(e));
    new ResizeObserver(() => { const w = this.host.clientWidth; if (w && w !== this.width) requestAnimationFrame(() => { this.width = w; this.draw(); }); }).observe(this.host);
  }
  idle() { this.at = null; this.read.textContent = ""; if (this.cursor) this.cursor.setAttribute("d", ""); }
  place(v, lim, log) { return log ? Math.log10(Math.max(v, 1e-300) / lim[0]) / Math.log10(lim[1] / lim[0]) : (v - lim[0]) / (lim[1] - lim[0]); }
  X(v) { return this.left + this.place(v, this.xlim, this.xlog) * this.w; }
  Y(v) { return this.top + (1 - this.place(v, this.ylim, this.ylog)) * this.h; }
  value_at(f, lim, log) { return log ? lim[0] * (lim[1] / lim[0]) ** f : lim[0] + f * (lim[1] - lim[0]); }
  unX(p) { return this.value_at((p - this.left) / this.w, this.xlim, this.xlog); }
  unY(p) { return this.value_at(1 - (p - this.top) / this.h, this.ylim, this.ylog); }
  path(x, y, close) {
    let d = "", pen = false;
    for (let i = 0; i < x.length; i++) {
      if (!Number.isFinite(y[i]) || !Number.isFinite(x[i]) || this.ylog && y[i] <= 0 || this.xlog && x[i] <= 0) { pen = false; continue; }
      d += (pen ? "L" : "M") + this.X(x[i]).toFixed(2) + " " + this.Y(y[i]).toFixed(2); pen = true;
    }
    return d && close ? d + "Z" : d;
  }
  draw() {
    if (!this.width) return;
    if (this.before) this.before();
    if (this.raster) { this.left = this.width < 420 ? 48 : 58; this.right = 54; this.top = 26; }
    this.w = Math.max(60, this.width - this.left - this.right);
    this.h = this.raster ? clamp(this.w * (this.shape || 1), 90, 620) : clamp(this.width * (this.tall && this.width > 420 ? this.tall : 0.62), 230, 480);
    if (this.raster && this.shape && this.w * this.shape > 620) this.w = 620 / this.shape;
    const rows = this.rows(), wide = 36 + 6.8 * Math.max(...rows.map(([, t]) => [...t].length));
    if (!this.raster && wide !== this.left) { this.left = wide; this.w = Math.max(60, this.width - this.left - this.right); }
    const H = this.h + this.top + this.bottom, s = this.svg, clip = `clip-${this.id}`;
    s.setAttribute("width", this.width); s.setAttribute("height", H); s.setAttribute("viewBox", `0 0 ${this.width} ${H}`);
    let out = `<defs><clipPath id="${clip}"><rect x="${this.left}" y="${this.top}" width="${this.w}" height="${this.h}"/></clipPath></defs>`;
    const x = this.names ? this.names.map((t, i) => [i, escape(t)]) : this.xlog ? decades(...this.xlim) : ticks(this.xlim[0], this.xlim[1], clamp(this.w / 70, 3, 8)), base = this.top + this.h;
    if (!this.raster) for (const [v] of rows) out += `<path class="gridline" d="M${this.left} ${this.Y(v)}h${this.w}"/>`;
    out += `<g clip-path="url(#${clip})">${this.content ? this.content() : ""}</g>`;
    out += `<g class="axis"><path d="M${this.left} ${this.top}V${base}H${this.left + this.w}"/>`;
    const every = this.names ? Math.ceil(x.length * Math.max(...this.names.map(t => t.length)) * 7.5 / this.w) : 1;
    x.forEach(([v, t], i) => { if (i % every === 0) out += `<path d="M${this.X(v)} ${base}v4"/><text x="${this.X(v)}" y="${base + 17}" text-anchor="middle">${t}</text>`; });
    for (const [v, t] of rows) out += `<path d="M${this.left} ${this.Y(v)}h-4"/><text x="${this.left - 7}" y="${this.Y(v) + 4}" text-anchor="end">${t}</text>`;
    out += `<text class="label" x="${this.left + this.w / 2}" y="${base + 36}" text-anchor="middle">${escape(this.xlabel)}</text>`;
    out += `<text class="label" transform="translate(13 ${this.top + this.h / 2}) rotate(-90)" text-anchor="middle">${escape(this.ylabel)}</text>`;
    if (this.bar) out += this.colorBar();
    s.innerHTML = out + `</g>${this.over ? this.over() : ""}<path class="cursor"/>`;
    this.cursor = s.lastElementChild;
    if (!this.raster) return;
    const r = Math.min(2, window.devicePixelRatio || 1), c = this.canvas, W = Math.round(this.w * r), h = Math.round(this.h * r);
    c.width = W; c.height = h; c.style.cssText = `left:${this.left}px;top:${this.top}px;width:${this.w}px;height:${this.h}px`;
    const g = c.getContext("2d"), image = g.createImageData(W, h);
    this.raster(new Uint32Array(image.data.buffer), W, h);
    g.putImageData(image, 0, 0);
  }
  rows() { return this.ylog ? decades(...this.ylim) : ticks(this.ylim[0], this.ylim[1], this.raster ? clamp(this.h / 60, 2, 8) : clamp(this.h / 50, 3, 7)); }
  colorBar() {
    const { lo, hi, name, label, log } = this.bar(), x = this.left + this.w + 10, id = `bar-${this.id}`;
    let out = `<defs><linearGradient id="${id}" x1="0" y1="1" x2="0" y2="0">${D.colors[name].map((c, i) => `<stop offset="${i / 63}" stop-color="${c}"/>`).join("")}</linearGradient></defs>`;
    out += `<rect x="${x}" y="${this.top}" width="10" height="${this.h}" fill="url(#${id})"/>`;
    const mark = v => this.top + this.h * (1 - (v - lo) / (hi - lo));
    const marks = log ? Array.from({ length: hi - lo + 1 }, (_, i) => [lo + i, lo + i === 0 ? "1" : power(lo + i)]) : ticks(lo, hi, clamp(this.h / 45, 2, 7));
    for (const [v, t] of marks) out += `<text x="${x + 14}" y="${mark(v) + 4}">${t}</text>`;
    return out + `<text class="label" x="${this.width}" y="14" text-anchor="end">${escape(label)}</text>`;
  }
  point(e) {
    const b = this.host.getBoundingClientRect(), x = e.clientX - b.left, y = e.clientY - b.top;
    if (x < this.left || x > this.left + this.w || y < this.top || y > this.top + this.h) return this.idle();
    this.show(x, y);
  }
  show(x, y) { this.at = [x, y]; const [text, d] = this.value(x, y); this.read.textContent = text; this.cursor.setAttribute("d", d); }
  cross(x, y) { return `M${x} ${this.top}V${this.top + this.h}M${this.left} ${y}H${this.left + this.w}`; }
  key(e) {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (move) {
      e.preventDefault();
      const step = (e.shiftKey ? 8 : 1) * Math.max(1, this.w / 150), [x, y] = this.at || [this.left + this.w / 2 - move[0] * step, this.top + this.h / 2 - move[1] * step];
      this.show(clamp(x + move[0] * step, this.left, this.left + this.w), clamp(y + move[1] * step, this.top, this.top + this.h));
    } else if (this.act && { "+": 1, "=": 1, "-": 1, "0": 1 }[e.key]) { e.preventDefault(); this.act({ "+": "in", "=": "in", "-": "out", "0": "home" }[e.key]); }
    else if (e.key === "Escape") this.idle();
  }
}
function legend(keys) {
  const p = document.createElement("p");
  p.className = "keys";
  p.innerHTML = keys.map(([cls, text]) => `<span><svg width="26" height="8" aria-hidden="true"><path class="series ${cls}" d="M0 4H26"/></svg>${escape(text)}</span>`).join("");
  return p;
}
const lookUp = (p, W, h, f) => { for (let r = 0; r < h; r++) for (let c = 0; c < W; c++) p[r * W + c] = f((c + 0.5) / W, 1 - (r + 0.5) / h); };

// Lines: with bands or bars of their errors, marks, limits; "pick" reads the line that is nearest, else all of them -------
function lines(s) {
  for (const l of s.lines) for (const k of ["x", "y", "error"]) if (l[k] && l[k].b64) l[k] = [...unpack(l[k])];
  const named = s.lines.filter(l => l.name);
  return new Plot(s.id, {
    xlim: s.x.limits, ylim: s.y.limits, xlog: s.x.log, ylog: s.y.log, xlabel: s.x.label, ylabel: s.y.label, names: s.x.names, tall: s.tall,
    keys: named.length > 1 || s.keys ? [...new Map(named.map(l => [l.name, l.style])).entries()].map(([n, c]) => [c, n]) : [],
    content() {
      let out = s.band ? `<rect class="band" x="${this.left}" width="${this.w}" y="${this.Y(s.band)}" height="${this.Y(-s.band) - this.Y(s.band)}"/>` : "";
      for (const l of s.lines) if (l.error && !l.dots) {
        const up = l.y.map((v, i) => v + l.error[i]), down = l.y.map((v, i) => this.ylog ? Math.max(v - l.error[i], this.ylim[0]) : v - l.error[i]);
        const d = this.path(l.x.concat([...l.x].reverse()), up.concat([...down].reverse()), true);
        out += `<path class="shade ${l.style}" d="${d}"/>`;
      }
      for (const m of s.limits || []) out += `<path class="limit" d="${m.x === undefined ? `M${this.left} ${this.Y(m.y)}h${this.w}` : `M${this.X(m.x)} ${this.top}v${this.h}`}"/>`;
      s.lines.forEach((l, k) => {
        if (!l.dots || l.joined) out += `<path class="series ${l.style}" style="${this.lit === k ? "stroke-width:3" : ""}" d="${this.path(l.x, l.y)}"/>`;
        if (l.dots) l.x.forEach((v, i) => {
          if (!Number.isFinite(l.y[i])) return;
          const x = this.X(v), y = this.Y(l.y[i]);
          if (l.error && l.error[i] > 0) out += `<path class="series solid ${l.style}" d="M${x} ${this.Y(l.y[i] + l.error[i])}V${this.Y(l.y[i] - l.error[i])}m-4 0h8"/><path class="series solid ${l.style}" d="M${x - 4} ${this.Y(l.y[i] + l.error[i])}h8"/>`;
          out += `<circle class="dot ${l.style}" r="3.5" cx="${x}" cy="${y}"/>`;
        });
      });
      for (const m of s.marks || []) out += `<circle class="mark" r="4" cx="${this.X(m.x)}" cy="${this.Y(m.y)}"/>`;
      return out;
    },
    over() {
      let out = "";
      for (const m of s.limits || []) if (m.text) out += m.x === undefined ? `<text class="note-text" x="${this.left + 6}" y="${this.Y(m.y) - 6}">${escape(m.text)}</text>` : `<text class="note-text" x="${this.X(m.x) + 5}" y="${this.top + 14}">${escape(m.text)}</text>`;
      if (s.gap) {
        const [a, b] = s.gap.x.map(v => this.X(v)), y = this.top + this.h * 0.86;
        out += `<path class="series twosolid" d="M${a} ${y}H${b}"/>` + s.gap.text.map((t, i) => `<text class="marktext" x="${b + 8}" y="${y - 4 + 17 * i}">${escape(t)}</text>`).join("");
      }
      return out;
    },
    value(px, py) {
      const at = this.unX(px), v = this.unY(py), u = s.y.unit ? ` ${s.y.unit}` : "";
      const where = l => { const i = nearest(l.x, at); return s.x.names ? s.x.names[i] : `${short(l.x[i])}${s.x.unit ? ` ${s.x.unit}` : ""}`; };
      const say = (l, i) => short(l.y[i]) + (l.error && Number.isFinite(l.error[i]) ? ` \u00b1 ${short(l.error[i])}` : "") + u;
      const far = l => { const i = nearest(l.x, at); return Math.abs(this.Y(l.y[i]) - this.Y(v)); };
      const own = s.pick ? s.lines.reduce((a, b) => far(b) < far(a) ? b : a) : s.lines[0], i = nearest(own.x, at), x = this.X(own.x[i]);
      const text = s.pick ? `${own.says || own.name}: ${say(own, i)} at ${where(own)}` : `${where(own)}: ` + s.lines.map(l => { const k = nearest(l.x, own.x[i]); return `${say(l, k)}${l.name ? ` ${l.name}` : ""}`; }).join(", ");
      const y = this.Y(own.y[i]);
      return [text, `M${x} ${this.top}v${this.h}` + (s.pick ? `M${x - 4} ${y}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0` : "")];
    },
  });
}

// Rasters: one, or a film with a slider and a play button -----------------------------------------------------------------
function raster(s) {
  const frames = s.frames.map(unpack), [rows, columns] = s.frames[0].shape, [lo, hi] = s.z.limits;
  let now = 0;
  const tone = v => { const t = s.z.log ? (Math.log10(Math.max(v, 1e-300)) - lo) / (hi - lo) : (v - lo) / (hi - lo); return LUT[s.map][clamp(Math.round(t * 255), 0, 255)]; };
  const cell = (u, n) => clamp(Math.floor(u * n), 0, n - 1);
  const plot = new Plot(s.id, {
    xlim: s.x.limits, ylim: s.y.limits, xlabel: s.x.label, ylabel: s.y.label, names: s.x.names, shape: s.shape,
    bar: () => ({ lo, hi, name: s.map, label: s.z.label, log: s.z.log }),
    raster: (p, W, h) => lookUp(p, W, h, (u, v) => { const q = frames[now][cell(v, rows) * columns + cell(u, columns)]; return Number.isNaN(q) ? (s.missing ? BELOW : 0) : s.error && Math.abs(q) < s.error ? BELOW : tone(q); }),
    value(x, y) {
      const q = frames[now][cell((y - this.top - this.h) / -this.h, rows) * columns + cell((x - this.left) / this.w, columns)], u = s.z.unit ? ` ${s.z.unit}` : "";
      const text = `${short(this.unX(x))}${s.x.unit ? ` ${s.x.unit}` : ""}, ${short(this.unY(y))}${s.y.unit ? ` ${s.y.unit}` : ""}: `;
      return [text + (Number.isNaN(q) ? "no value" : `${short(q)}${u}${s.error && Math.abs(q) < s.error ? ", below its error" : ""}`), this.cross(x, y)];
    },
  });
  const slider = plot.panel.querySelector("[data-film]");
  if (!slider) return plot;
  const says = plot.panel.querySelector(".says"), play = plot.panel.querySelector("[data-play]");
  const show = k => { now = k; slider.value = k; says.textContent = s.times[k]; plot.draw(); };
  let timer = 0;
  slider.addEventListener("input", () => show(+slider.value));
  play.addEventListener("click", () => {
    if (timer) { clearInterval(timer); timer = 0; } else timer = setInterval(() => show((now + 1) % frames.length), 120);
    play.textContent = timer ? "Pause" : "Play";
  });
  show(0);
  return plot;
}

// Density: cells of a structured mesh drawn as they are, or a raster; each pixel knows its value ---------------------------
function air(all) {
  const m = all.air, grid = m.raster ? unpack(m.raster) : null;
  const mz = m.z && unpack(m.z), my = m.y && unpack(m.y), rho = grid || unpack(m.rho), [NI, NJ] = grid ? m.raster.shape : m.z.shape;
  const [low, high] = m.limits, shade = v => LUT.density[clamp(Math.round((v - low) / (high - low) * 255), 0, 255)];
  let meshEnd = Infinity;
  if (mz) for (const v of mz) if (v < meshEnd) meshEnd = v;
  const inside = (p, z, y) => { let odd = false; for (let i = 0, j = p.length - 1; i < p.length; j = i++) { const [zi, yi] = p[i], [zj, yj] = p[j]; if ((yi > y) !== (yj > y) && z < (zj - zi) * (y - yi) / (yj - yi) + zi) odd = !odd; } return odd; };
  class Air extends Plot {
    constructor(s) {
      super(s.id, {
        xlabel: "z [mm], optical axis, forward \u2192", ylabel: "y [mm]", view: { ...s.view }, home: { ...s.view }, shape: s.view.shape, rays: true,
        bar: () => ({ lo: low, hi: high, name: "density", label: "density [kg/m\u00b3]" }),
        raster: (p, W, h) => grid ? this.look(p, W, h) : this.cells(p, W, h), before: () => this.limits(), content: () => this.lines(), value: (x, y) => this.say(x, y),
      });
      this.host.classList.add("moves");
      this.gestures();
      this.panel.querySelectorAll("[data-act]").forEach(b => b.addEventListener(b.type === "checkbox" ? "change" : "click", () => this.act(b.dataset.act, b)));
    }
    limits() { const { z, y, span } = this.view, half = span / 2 / this.shape; this.xlim = [z - half, z + half]; this.ylim = [y - span / 2, y + span / 2]; }
    sample(z, y) { // a raster's value; NaN outside
      if (m.mirror) y = Math.abs(y);
      const i = Math.floor((y - m.y0) / m.dy), j = Math.floor((z - m.z0) / m.dz);
      return i < 0 || j < 0 || i >= NI || j >= NJ ? NaN : grid[i * NJ + j];
    }
    look(p, W, h) {
      const [x0, x1] = this.xlim, [y0, y1] = this.ylim, still = shade(m.ambient);
      lookUp(p, W, h, (u, v) => { const q = this.sample(x0 + u * (x1 - x0), y0 + v * (y1 - y0)); return Number.isNaN(q) ? still : shade(q); });
    }
    cells(p, W, h) {
      const [x0, x1] = this.xlim, [y0, y1] = this.ylim, sx = W / (x1 - x0), sy = h / (y1 - y0);
      const still = shade(m.ambient), first = clamp(Math.ceil((meshEnd - x0) * sx), 0, W);
      for (let r = 0; r < h; r++) p.fill(still, r * W + (m.openEnd ? first : 0), r * W + W);
      const qx = new Float64Array(4), qy = new Float64Array(4);
      for (const sign of m.mirror ? [1, -1] : [1]) for (let i = 0; i < NI - 1; i++) for (let j = 0; j < NJ - 1; j++) {
        const a = i * NJ + j, corner = [a, a + NJ, a + NJ + 1, a + 1];
        let lx = 1e9, hx = -1e9, ly = 1e9, hy = -1e9;
        for (let k = 0; k < 4; k++) {
          const x = qx[k] = (mz[corner[k]] - x0) * sx, y = qy[k] = (y1 - sign * my[corner[k]]) * sy;
          if (x < lx) lx = x; if (x > hx) hx = x; if (y < ly) ly = y; if (y > hy) hy = y;
        }
        if (hx < 0 || lx > W || hy < 0 || ly > h) continue;
        const color = shade(rho[i * (NJ - 1) + j]);
        const c0 = Math.max(0, Math.ceil(lx - 0.5)), c1 = Math.min(W - 1, Math.floor(hx - 0.5)), r0 = Math.max(0, Math.ceil(ly - 0.5)), r1 = Math.min(h - 1, Math.floor(hy - 0.5));
        for (let r = r0; r <= r1; r++) for (let c = c0; c <= c1; c++) {
          let up = true, down = true;
          for (let k = 0; k < 4; k++) {
            const n = k + 1 & 3, t = (qx[n] - qx[k]) * (r + 0.5 - qy[k]) - (qy[n] - qy[k]) * (c + 0.5 - qx[k]);
            if (t < -1e-9) up = false; if (t > 1e-9) down = false;
          }
          if (up || down) p[r * W + c] = color;
        }
      }
    }
    lines() {
      let out = m.bodies.map(b => `<path class="body" d="${this.path(b.map(v => v[0]), b.map(v => v[1]), true)}"/>`).join("");
      if (this.rays && m.rays) m.rays.forEach(r => { out += `<path class="ray" d="${this.path(r.z, this.bend ? r.y.map((v, i) => v + 1e-6 * 1000 * r.stray[i]) : r.y)}"/>`; });
      if (m.pupil) { const [[za, ya], [zb, yb]] = m.pupil; out += `<path class="ray" style="stroke-width:3" d="M${this.X(za)} ${this.Y(ya)}L${this.X(zb)} ${this.Y(yb)}"/><text class="onpicture" x="${this.X(zb) + 4}" y="${this.Y(yb) - 7}">pupil</text>`; }
      if (m.arrow) {
        const fx = this.left + this.w - 12, fy = this.top + 18;
        out += `<text class="onpicture" x="${fx - 44}" y="${fy + 4}" text-anchor="end">flow</text><path class="ray" style="stroke-width:1.5" d="M${fx} ${fy}h-36m6 -4l-6 4l6 4"/>`;
      }
      if (this.frame && this.frame.xlim) { const f = this.frame, x = this.X(f.xlim[0]), y = this.Y(f.ylim[1]); out += `<rect class="frame" x="${x}" y="${y}" width="${Math.max(3, this.X(f.xlim[1]) - x)}" height="${Math.max(3, this.Y(f.ylim[0]) - y)}"/>`; }
      return out;
    }
    density(z, y) { // exactly that of the cell, whatever the size of a pixel; NaN where there is no cell
      if (grid) return this.sample(z, y);
      if (m.mirror) y = Math.abs(y);
      for (let i = 0; i < NI - 1; i++) for (let j = 0; j < NJ - 1; j++) {
        const a = i * NJ + j, k = [a, a + NJ, a + NJ + 1, a + 1];
        let up = true, down = true;
        for (let n = 0; n < 4 && (up || down); n++) { const p = k[n], q = k[n + 1 & 3], t = (mz[q] - mz[p]) * (y - my[p]) - (my[q] - my[p]) * (z - mz[p]); if (t < -1e-9) up = false; if (t > 1e-9) down = false; }
        if (up || down) return rho[i * (NJ - 1) + j];
      }
      return NaN;
    }
    say(x, y) {
      const z = this.unX(x), v = this.unY(y), q = this.density(z, v);
      const words = d => `${d.toFixed(3)} kg/m\u00b3, ${(d / m.ambient).toFixed(2)} \u00d7 free stream` + (m.k ? `, n \u2212 1 = ${(m.k * d * 1e6).toFixed(1)} \u00d7 ${power(-6)}` : "");
      const what = m.bodies.some(b => inside(b, z, v)) ? "body" : Number.isNaN(q) ? "outside the flow's mesh" : words(q);
      return [`z ${fixed(z, 2)} mm, y ${fixed(v, 2)} mm: ${what}`, this.cross(x, y)];
    }
    zoom(factor, x = this.left + this.w / 2, y = this.top + this.h / 2) {
      const v = this.view, z = this.unX(x), yy = this.unY(y), span = clamp(v.span * factor, this.home.span / 200, m.reach), f = span / v.span;
      Object.assign(v, { z: z + (v.z - z) * f, y: yy + (v.y - yy) * f, span });
      this.later();
    }
    later() { if (!this.waiting) this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(); if (this.linked) this.linked.draw(); }); }
    act(what, box) {
      if (what === "in") this.zoom(0.7); else if (what === "out") this.zoom(1 / 0.7);
      else if (what === "home") { Object.assign(this.view, this.home); this.later(); }
      else { this[what] = box.checked; this.later(); }
    }
    gestures() {
      const down = new Map();
      this.host.addEventListener("wheel", e => { if (!e.ctrlKey && !e.metaKey) return; e.preventDefault(); const b = this.host.getBoundingClientRect(); this.zoom(Math.exp(e.deltaY * 0.002), e.clientX - b.left, e.clientY - b.top); }, { passive: false });
      this.host.addEventListener("pointerdown", e => { down.set(e.pointerId, [e.clientX, e.clientY]); this.host.setPointerCapture(e.pointerId); this.held = true; });
      this.host.addEventListener("pointermove", e => {
        const was = down.get(e.pointerId); if (!was) return;
        const now = [e.clientX, e.clientY], mm = this.view.span / this.h;
        if (down.size === 2) {
          const other = [...down].find(([id]) => id !== e.pointerId)[1], gap = p => Math.hypot(p[0] - other[0], p[1] - other[1]), b = this.host.getBoundingClientRect();
          this.zoom(gap(was) / Math.max(1, gap(now)), (now[0] + other[0]) / 2 - b.left, (now[1] + other[1]) / 2 - b.top);
        } else { this.view.z -= (now[0] - was[0]) * mm; this.view.y += (now[1] - was[1]) * mm; this.later(); }
        down.set(e.pointerId, now);
      });
      for (const end of ["pointerup", "pointercancel"]) this.host.addEventListener(end, e => { down.delete(e.pointerId); this.held = down.size > 0; });
    }
  }
  const made = all.views.map(s => new Air(s));
  if (made.length > 1) { made[0].frame = made[1]; made[1].linked = made[0]; }
  return made;
}

// Wavefront: terms are fitted together over the pupil's pixels; map, cuts, image of a point and its cuts are linked ---------
function wavefront(s) {
  const opd = unpack(s.opd), weight = s.weight && unpack(s.weight), intensity = s.intensity && unpack(s.intensity), errors = unpack(s.errors), [PY, PX] = s.opd.shape, axis = s.axis, live = [];
  for (let i = 0; i < opd.length; i++) if (!Number.isNaN(opd[i])) live.push(i);
  const W = Float64Array.from(live, i => weight ? weight[i] : 1), all = W.reduce((a, b) => a + b, 0); // amplitudes
  const V = Float64Array.from(live, (i, n) => intensity ? intensity[i] : W[n] * W[n]), light = V.reduce((a, b) => a + b, 0); // by which terms are fitted
  const fact = n => n < 2 ? 1 : n * fact(n - 1), basis = [];
  const noll = j => { const n = Math.floor((Math.sqrt(8 * j - 7) - 1) / 2), k = j - n * (n + 1) / 2 - 1, m = n % 2 ? 2 * Math.floor(k / 2) + 1 : 2 * Math.floor((k + 1) / 2); return [n, j % 2 ? -m : m]; };
  function polynomial(j) {
    if (basis[j]) return basis[j];
    const [n, m] = noll(j), a = Math.abs(m), c = [];
    for (let t = 0; t <= (n - a) / 2; t++) c.push([(t % 2 ? -1 : 1) * fact(n - t) / fact(t) / fact((n + a) / 2 - t) / fact((n - a) / 2 - t), n - 2 * t]);
    return basis[j] = Float64Array.from(live, i => {
      const x = axis[i % PX] / s.radius, y = axis[Math.floor(i / PX)] / s.radius, r = Math.hypot(x, y), t = Math.atan2(y, x);
      let v = 0; for (const [f, p] of c) v += f * r ** p;
      return v * (m ? Math.sqrt(2 * (n + 1)) * (m > 0 ? Math.cos(a * t) : Math.sin(a * t)) : Math.sqrt(n + 1));
    });
  }
  function without(terms) {
    const B = terms.map(polynomial), n = B.length, N = live.length, A = B.map(() => new Float64Array(n + 1));
    for (let a = 0; a < n; a++) { for (let b = 0; b <= a; b++) { let t = 0; for (let k = 0; k < N; k++) t += V[k] * B[a][k] * B[b][k]; A[a][b] = A[b][a] = t; } let t = 0; for (let k = 0; k < N; k++) t += V[k] * B[a][k] * opd[live[k]]; A[a][n] = t; }
    for (let c = 0; c < n; c++) { // Gauss with pivots
      let p = c; for (let r = c + 1; r < n; r++) if (Math.abs(A[r][c]) > Math.abs(A[p][c])) p = r;
      [A[c], A[p]] = [A[p], A[c]];
      for (let r = 0; r < n; r++) if (r !== c) { const f = A[r][c] / A[c][c]; for (let k = c; k <= n; k++) A[r][k] -= f * A[c][k]; }
    }
    const out = new Float64Array(opd.length).fill(NaN);
    for (let k = 0; k < N; k++) { let v = opd[live[k]]; for (let a = 0; a < n; a++) v -= A[a][n] / A[a][a] * B[a][k]; out[live[k]] = v; }
    return out;
  }
  const NA = 161, mid = (NA - 1) / 2;
  let angle = [], turns = null;
  const field = which => { const most = s.angles[which]; angle = Array.from({ length: NA }, (_, i) => most * (2 * i / (NA - 1) - 1)); turns = null; };
  function focus(map) { // |sum w exp(ik OPD) exp(-ik a x)|^2 / (sum w)^2, along one axis after the other
    const k = 2 * Math.PI, er = new Float64Array(opd.length), ei = new Float64Array(opd.length);
    live.forEach((i, n) => { const f = map ? k * map[i] / s.wave : 0; er[i] = W[n] * Math.cos(f); ei[i] = W[n] * Math.sin(f); });
    if (!turns) { const c = new Float64Array(NA * PX), q = new Float64Array(NA * PX); for (let a = 0; a < NA; a++) for (let p = 0; p < PX; p++) { const f = k * angle[a] * axis[p] / s.wave; c[a * PX + p] = Math.cos(f); q[a * PX + p] = Math.sin(f); } turns = [c, q]; }
    const [c, q] = turns, tr = new Float64Array(PY * NA), ti = new Float64Array(PY * NA), out = new Float64Array(NA * NA);
    for (let r = 0; r < PY; r++) for (let a = 0; a < NA; a++) { let u = 0, v = 0; for (let p = 0; p < PX; p++) { const e = er[r * PX + p], f = ei[r * PX + p], x = c[a * PX + p], y = q[a * PX + p]; u += e * x + f * y; v += f * x - e * y; } tr[a * PY + r] = u; ti[a * PY + r] = v; }
    for (let b = 0; b < NA; b++) for (let a = 0; a < NA; a++) { let u = 0, v = 0; for (let r = 0; r < PY; r++) { const e = tr[a * PY + r], f = ti[a * PY + r], x = c[b * PX + r], y = q[b * PX + r]; u += e * x + f * y; v += f * x - e * y; } out[b * NA + a] = (u * u + v * v) / (all * all); }
    return out;
  }
  const state = { map: null, psf: null, perfect: null, rms: 0, reach: 1, log: true, grey: false };
  const half = (axis[1] - axis[0]) / 2, span = [axis[0] - half, axis[PX - 1] + half], [across, up] = s.axes;
  const map = new Plot("opd", {
    xlim: span, ylim: span, xlabel: `${across} [mm]`, ylabel: `${up} [mm]`,
    bar: () => ({ lo: -state.reach, hi: state.reach, name: "delay", label: "OPD [nm], + is delayed" }),
    raster: (p, w, h) => lookUp(p, w, h, (u, v) => {
      const k = Math.min(PY - 1, Math.floor(v * PY)) * PX + Math.min(PX - 1, Math.floor(u * PX)), o = state.map[k];
      return Number.isNaN(o) ? 0 : state.grey && Math.abs(o) < errors[k] ? BELOW : LUT.delay[clamp(Math.round((o / state.reach + 1) * 127.5), 0, 255)];
    }),
    value(x, y) {
      const c = nearest(axis, this.unX(x)), r = nearest(axis, this.unY(y)), k = r * PX + c, o = state.map[k];
      return [`${across} ${fixed(axis[c], 2)} mm, ${up} ${fixed(axis[r], 2)} mm: ` + (Number.isNaN(o) ? "outside the pupil" : short(o) + (Number.isNaN(errors[k]) ? " nm" : ` \u00b1 ${short(errors[k])} nm`) + (Math.abs(o) < errors[k] ? ", below its error" : "")), this.cross(x, y)];
    },
  });
  const middle = (PX - 1) / 2 | 0, cutX = () => axis.map((_, i) => state.map[middle * PX + i]), cutY = () => axis.map((_, i) => state.map[i * PX + middle]);
  const cuts = new Plot("cuts", {
    tall: 0.8, xlim: span, xlabel: `${across} or ${up} [mm]`, ylabel: "OPD [nm]", keys: [["one", `along ${across}`], ["two", `along ${up}`]],
    before() { const m = Math.max(state.reach, s.error * 1.3) * 1.08; this.ylim = [-m, m]; },
    content() { return `<rect class="band" x="${this.left}" width="${this.w}" y="${this.Y(s.error)}" height="${this.Y(-s.error) - this.Y(s.error)}"/><path class="series one" d="${this.path(axis, cutX())}"/><path class="series two" d="${this.path(axis, cutY())}"/>`; },
    value(x) { const i = nearest(axis, this.unX(x)); return [`${fixed(axis[i], 2)} mm from the center: ${short(cutX()[i])} nm along ${across}, ${short(cutY()[i])} nm along ${up}`, `M${this.X(axis[i])} ${this.top}v${this.h}`]; },
  });
  const bright = v => v < 1e-3 ? minus(v.toExponential(1)) : v.toFixed(4);
  const between = (f, u, v) => { const i = Math.min(NA - 2, Math.floor(u)), j = Math.min(NA - 2, Math.floor(v)), a = u - i, b = v - j, k = j * NA + i; return (f[k] * (1 - a) + f[k + 1] * a) * (1 - b) + (f[k + NA] * (1 - a) + f[k + NA + 1] * a) * b; };
  const psf = new Plot("psf", {
    before() { this.xlim = this.ylim = [angle[0], angle[NA - 1]]; }, xlabel: `angle toward ${across} [\u00b5rad]`, ylabel: `angle toward ${up} [\u00b5rad]`,
    bar: () => state.log ? { lo: -5, hi: 0, log: true, name: "light", label: "over the undisturbed peak" } : { lo: 0, hi: 1, name: "light", label: "over the undisturbed peak" },
    raster: (p, w, h) => lookUp(p, w, h, (u, v) => { const q = between(state.psf, u * (NA - 1), v * (NA - 1)); return LUT.light[clamp(Math.round((state.log ? Math.log10(q + 1e-12) / 5 + 1 : q) * 255), 0, 255)]; }),
    value(x, y) { const c = nearest(angle, this.unX(x)), r = nearest(angle, this.unY(y)); return [`${short(angle[c])} \u00b5rad toward ${across}, ${short(angle[r])} \u00b5rad toward ${up}: ${bright(state.psf[r * NA + c])} of the undisturbed peak`, this.cross(x, y)]; },
  });
  const alongX = f => angle.map((_, i) => f[mid * NA + i]), alongY = f => angle.map((_, i) => f[i * NA + mid]);
  const psfCuts = new Plot("psfcuts", {
    tall: 0.8, xlabel: "angle [\u00b5rad]", ylabel: "over the undisturbed peak", keys: [["plain", "without flow"], ["one", `along ${across}`], ["two", `along ${up}`]],
    before() { this.xlim = [angle[0], angle[NA - 1]]; this.ylog = state.log; this.ylim = state.log ? [1e-5, 2] : [0, 1.05]; },
    content() { const p = f => this.path(angle, f.map(v => Math.max(v, 1e-7))); return `<path class="series plain" d="${p(alongX(state.perfect))}"/><path class="series one" d="${p(alongX(state.psf))}"/><path class="series two" d="${p(alongY(state.psf))}"/>`; },
    value(x) { const i = nearest(angle, this.unX(x)); return [`${short(angle[i])} \u00b5rad: ${bright(alongX(state.psf)[i])} with flow, ${bright(alongX(state.perfect)[i])} without`, `M${this.X(angle[i])} ${this.top}v${this.h}`]; },
  });
  const terms = [...map.panel.querySelectorAll("[data-term]")], choice = map.panel.querySelector('[data-act="noll"]'), says = map.panel.querySelector(".says");
  function refresh() {
    const js = new Set([1]);
    for (const t of terms) if (t.checked) for (const j of s.groups[t.dataset.term] || []) js.add(j);
    for (let j = 1; j <= +choice.value; j++) js.add(j);
    state.map = without([...js]);
    let sum = 0, lo = 0, hi = 0;
    live.forEach((i, n) => { const v = state.map[i]; sum += V[n] * v * v; if (v < lo) lo = v; if (v > hi) hi = v; });
    state.rms = Math.sqrt(sum / light); state.reach = Math.max(hi, -lo) || 1;
    state.grey = state.rms < 3 * s.error;
    state.psf = focus(state.map); state.perfect = state.perfect || focus(null);
    const peak = state.psf[mid * NA + mid];
    says.textContent = `${js.size === 1 ? "What the flow adds to the light\u2019s path" : "What is left"}: ${short(state.rms)} nm rms, ${short(hi - lo)} nm peak to valley` + (state.rms < s.error ? `. That is below its error, ${short(s.error)} nm: do not read the pattern.` : ". Orange is delayed.");
    psf.panel.querySelector(".says").textContent = `Image of a distant point, ${js.size === 1 ? "tilt included" : "with the same terms removed"}. On the axis ${peak.toFixed(4)} of the undisturbed peak.`;
    for (const p of [map, cuts, psf, psfCuts]) p.draw();
  }
  field(0);
  for (const t of terms) t.addEventListener("change", refresh);
  choice.addEventListener("change", refresh);
  psf.panel.querySelectorAll('[name="scale"]').forEach(b => b.addEventListener("change", () => { state.log = b.dataset.act === "log"; psf.draw(); psfCuts.draw(); }));
  psf.panel.querySelector('[data-act="field"]').addEventListener("change", e => { field(+e.target.value); state.perfect = null; refresh(); });
  refresh();
  return { state, without, refresh };
}

// Page ------------------------------------------------------------------------------------------------------------------
const KINDS = { lines, raster, air, wavefront }, made = {};
for (const s of D.plots) made[s.id || s.kind] = KINDS[s.kind](s);
for (const p of plots) { p.width = p.host.clientWidth; p.draw(); }
for (const b of document.querySelectorAll(".copy")) {
  b.hidden = !navigator.clipboard;
  b.addEventListener("click", () => navigator.clipboard.writeText(b.previousElementSibling.textContent).then(() => { b.textContent = "Copied"; setTimeout(() => { b.textContent = "Copy"; }, 1500); }));
}
for (const a of document.querySelectorAll('a[href^="#w-"]')) a.addEventListener("click", () => { document.getElementById("words").open = true; });
const opened = [];
addEventListener("beforeprint", () => { for (const d of document.querySelectorAll("details.printed:not([open])")) { d.open = true; opened.push(d); } });
addEventListener("afterprint", () => { for (const d of opened.splice(0)) d.open = false; });
window.report = made;
})();
