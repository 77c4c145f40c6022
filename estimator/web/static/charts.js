// Pictures by uPlot with the page's colours: one place that knows how it wants to be told.
/* global uPlot */

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const charts = new Set();

function hour(seconds, step = 1) {
  const parts = { hour: "2-digit", minute: "2-digit", hour12: false, ...(step < 60 ? { second: "2-digit" } : {}) };
  return new Date(seconds * 1000).toLocaleTimeString([], parts);
}

function width(place) {
  return Math.max(200, place.clientWidth);
}

// One that is made while it is hidden has no width yet, and gets it when it is shown.
const widths = new ResizeObserver((entries) => {
  for (const one of charts) {
    if (entries.some((entry) => entry.target === one.figure) && one.figure.clientWidth && one.plot.width !== width(one.figure))
      one.plot.setSize({ width: width(one.figure), height: one.plot.height });
  }
});

// series: [{ label, colour, dash, width, dots }]; bands between pairs of series; behind(u) draws below the lines.
export function chart(place, { label, title, height = 130, series, bands = [], behind, range, clock = true, times = true }) {
  const figure = document.createElement("figure");
  figure.setAttribute("role", "img");
  figure.setAttribute("aria-label", label);
  place.append(figure);
  const made = { figure, data: [[], ...series.map(() => [])], plot: null };
  made.draw = () => {
    made.plot?.destroy();
    const axis = { stroke: () => css("dim"), grid: { stroke: () => css("line"), width: 1 }, ticks: { show: false }, font: "13px system-ui, sans-serif" };
    const values = (u, ticks, _axis, _space, step) => ticks.map((tick) => (clock ? hour(tick, step) : `${tick} s`.replace("-", "−")));
    made.plot = new uPlot({
      width: width(figure), height, pxAlign: false, cursor: { show: false }, legend: { show: false },
      scales: { x: { time: clock }, y: range ? { range } : {} },
      axes: [{ ...axis, values, ...(times ? {} : { values: (u, ticks) => ticks.map(() => "") }), size: times ? 28 : 6, ...(clock ? { space: 96 } : {}) }, { ...axis, label: title, labelFont: "600 13px system-ui, sans-serif", labelSize: 20, size: 58 }],
      series: [{}, ...series.map((one) => ({ label: one.label, stroke: one.colour ? () => css(one.colour) : undefined, dash: one.dash, width: one.width ?? 1.5,
        points: { show: Boolean(one.dots), size: 6, width: 0, fill: () => css(one.colour) }, ...(one.dots ? { paths: () => null } : {}), spanGaps: false }))],
      bands: bands.map(([high, low, colour]) => ({ series: [high, low], fill: () => `color-mix(in srgb, ${css(colour)} 22%, transparent)` })),
      hooks: behind ? { drawAxes: [behind] } : {},
    }, made.data, figure);
  };
  made.set = (data) => { made.data = data; made.plot.setData(data); };
  made.draw();
  charts.add(made);
  widths.observe(figure);
  return made;
}

export function stripe(u, from, to, colour, alpha) {
  const { left, top, width: wide, height } = u.bbox;
  const a = Math.max(left, u.valToPos(from, "x", true)), b = Math.min(left + wide, Math.max(u.valToPos(to, "x", true), a + 2));
  if (b <= left || a >= left + wide) return;
  u.ctx.save();
  u.ctx.globalAlpha = alpha;
  u.ctx.fillStyle = css(colour);
  u.ctx.fillRect(a, top + height - 5 * devicePixelRatio, b - a, 5 * devicePixelRatio); // along the foot: over days it hides nothing
  u.ctx.restore();
}

export function post(u, at, colour) {
  const { left, top, width: wide, height } = u.bbox, x = u.valToPos(at, "x", true);
  if (x < left || x > left + wide) return;
  u.ctx.save();
  u.ctx.strokeStyle = css(colour);
  u.ctx.lineWidth = 2 * devicePixelRatio;
  u.ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
  u.ctx.beginPath();
  u.ctx.moveTo(x, top);
  u.ctx.lineTo(x, top + height);
  u.ctx.stroke();
  u.ctx.restore();
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => charts.forEach((one) => one.draw()));
