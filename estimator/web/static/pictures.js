// The small pictures of a tile: how fast it turns now, and how its bias went.

const colours = {};
const theme = matchMedia("(prefers-color-scheme: dark)");

function read() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "dim", "line", "x", "y", "z", "busy"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
}
read();
theme.addEventListener("change", read);

export function colour(name) {
  return colours[name];
}

function fit(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (width && height && (canvas.width !== width || canvas.height !== height)) {
    canvas.width = width;
    canvas.height = height;
  }
  return ratio;
}

// Slow turns are seen beside fast ones: the height is the square root of the rate.
const FULL_DPS = 360, LATE_FRAMES = 4;

export class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.held = [NaN, NaN, 0];
    this.size();
  }

  size() {
    this.step = Math.max(1, Math.round(fit(this.canvas)));
  }

  // What comes a frame late is no silence: for a moment the last is drawn on.
  draw(least, most) {
    if (!Number.isNaN(most)) this.held = [least, most, 0];
    else if (this.held[2]++ < LATE_FRAMES) [least, most] = this.held;
    const { canvas, pen, step } = this, height = canvas.height;
    pen.globalCompositeOperation = "copy";
    pen.drawImage(canvas, -step, 0);
    pen.globalCompositeOperation = "source-over";
    const x = canvas.width - step;
    if (Number.isNaN(most)) {
      pen.clearRect(x, 0, step, height);
      return;
    }
    const top = height - Math.min(1, Math.sqrt(most / FULL_DPS)) * (height - 2) - 1;
    const low = height - Math.min(1, Math.sqrt(least / FULL_DPS)) * (height - 2) - 1;
    pen.clearRect(x, 0, step, height);
    pen.fillStyle = colours.busy;
    pen.globalAlpha = 0.25;
    pen.fillRect(x, low, step, height - low);
    pen.globalAlpha = 1;
    pen.fillRect(x, top, step, Math.max(step, low - top));
  }
}

// Three lines with their intervals, each against its own mean: what moved, and whether that is more than is known.
export function spark(canvas, rows, points) {
  fit(canvas);
  const pen = canvas.getContext("2d"), { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  let reach = 0.02;
  const means = [0, 1, 2].map((axis) => {
    let sum = 0, n = 0;
    for (let i = 0; i < points; i++) if (!Number.isNaN(rows[6 * i + axis])) { sum += rows[6 * i + axis]; n++; }
    return n ? sum / n : NaN;
  });
  for (let i = 0; i < points; i++)
    for (let axis = 0; axis < 3; axis++) {
      const away = Math.abs(rows[6 * i + axis] - means[axis]) + Math.min(rows[6 * i + 3 + axis], 0.3);
      if (away > reach) reach = away;
    }
  pen.fillStyle = colours.line;
  pen.fillRect(0, Math.round(height / 2), width, 1);
  const x = (i) => (i / (points - 1)) * width, y = (value) => height / 2 - (value / reach) * (height / 2 - 2);
  ["x", "y", "z"].forEach((name, axis) => {
    const value = (i) => rows[6 * i + axis] - means[axis], std = (i) => rows[6 * i + 3 + axis];
    const band = new Path2D(), line = new Path2D();
    let open = false;
    for (let i = 0; i < points; i++) {
      if (Number.isNaN(value(i))) { open = false; continue; }
      line[open ? "lineTo" : "moveTo"](x(i), y(value(i)));
      const next = i + 1 < points && !Number.isNaN(value(i + 1));
      if (next) {
        band.moveTo(x(i), y(value(i) + std(i)));
        band.lineTo(x(i + 1), y(value(i + 1) + std(i + 1)));
        band.lineTo(x(i + 1), y(value(i + 1) - std(i + 1)));
        band.lineTo(x(i), y(value(i) - std(i)));
      }
      open = true;
    }
    pen.fillStyle = pen.strokeStyle = colours[name];
    pen.globalAlpha = 0.2;
    pen.fill(band);
    pen.globalAlpha = 1;
    pen.lineWidth = 1.5;
    pen.stroke(line);
  });
}
