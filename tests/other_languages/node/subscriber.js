// A minimal subscriber of truerate, written from docs/wire.md and truerate.proto alone: it tests that they are enough.
//
//     node subscriber.js truerate.proto FILE
//
// FILE holds what a zenoh subscriber would be given: again and again the length of a key and of its payload (each an unsigned
// 32-bit number, little-endian), the key, the payload. One JSON object a line comes out: what a message says, or why it is refused.
import { readFileSync } from "node:fs";
import protobuf from "protobufjs";

const [proto, file] = process.argv.slice(2);
const schema = protobuf.loadSync(proto);
const KINDS = { corrected: "CorrectedBatch", revision: "BiasRevision", status: "Status", "@windowed": "WindowBatch" };
const MOST = 2n ** 62n; // sequence numbers and times
const ID = /^[a-z0-9][a-z0-9_-]{0,31}$/;

class Refused extends Error {}
const check = (holds, why) => {
  if (!holds) throw new Refused(why);
};
const within = (values, count, low, high, name) => {
  check(values.length === count, `length: ${name} has ${values.length} values, not ${count}`);
  for (const value of values) check(Number.isFinite(value) && low <= value && value <= high, `range: ${name} has ${value}`);
};
const whole = (value, high, name) => check(0n <= value && value <= high, `range: ${name} is ${value}`);
const rising = (values, high, name) => {
  for (const value of values) whole(value, high, name);
  check(values.every((value, i) => i === 0 || values[i - 1] < value), `range: ${name} does not rise`);
};
const text = (value, most, name) => {
  check([...value].length <= most, `length: ${name}`);
  check(!/[\p{C}\p{Zl}\p{Zp}]|(?! )\p{Zs}/u.test(value), `malformed: ${name} cannot be printed`);
};
const big = (value) => BigInt(value.toString()); // 64-bit numbers do not fit a JavaScript number
const known = (name) => Object.values(schema.lookupEnum(`truerate.v1.${name}`).values);
const FLAGS = known("SampleFlag").reduce((all, bit) => all | bit, 0);

function open(key, payload) {
  const [root, version, ward, what, device, ...more] = key.split("/");
  check(root === "truerate" && version === "@v1" && ID.test(ward) && KINDS[what] && more.length === 0, "key");
  check(ID.test(device), "id");
  check(payload.length <= 65536, "too large");
  let message;
  try {
    message = schema.lookupType(`truerate.v1.${KINDS[what]}`).decode(payload);
  } catch (error) {
    throw new Refused(`malformed: ${error.message}`);
  }
  check(message.version === 1, `version: ${message.version}`);
  check(message.device === device, `device: ${message.device}`);
  return [what, message];
}

function corrected(raw) {
  const n = raw.ticks.length;
  const batch = {
    device: raw.device, boot: big(raw.boot), sequence: big(raw.sequence), start: big(raw.startTimeNs),
    period: raw.tickPeriodS, clock: raw.clockRate, ticks: raw.ticks.map(big), rate: vectors(raw.rate),
    quality: raw.quality, noise: raw.noiseStd, biasStd: raw.biasStd, scale: raw.scaleStd, cross: raw.crossStd,
    bias: raw.bias, calibration: raw.calibration, epoch: big(raw.epoch), flicker: raw.flickerStd,
  };
  whole(batch.epoch, MOST, "epoch");
  check(1 <= n && n <= 1024, `length: ${n} samples`);
  whole(batch.sequence, MOST, "sequence");
  whole(batch.start, MOST, "start_time_ns");
  within([batch.period], 1, 1e-9, 1, "tick_period_s");
  within([batch.clock], 1, 1e-4, 1e4, "clock_rate");
  rising(batch.ticks, 2n ** 63n - 1n, "ticks");
  const lasts = Number(batch.ticks[n - 1] - batch.ticks[0]) * batch.period * batch.clock * 1e9;
  whole(batch.start + BigInt(Math.round(lasts)), MOST, "the time of the last sample");
  within(raw.rate, 3 * n, -2000, 2000, "rate");
  for (const name of ["noiseStd", "biasStd", "scaleStd", "crossStd"]) within(raw[name], 3, 0, 1e6, name);
  if (raw.flickerStd.length) within(raw.flickerStd, 3, 0, 1e6, "flickerStd");
  within(raw.bias, 3, -1000, 1000, "bias");
  check(raw.flags.length === 0 || raw.flags.length === n, "length: flags");
  for (const flags of raw.flags) check((flags & ~FLAGS) === 0, `range: flags ${flags}`);
  check(known("Quality").includes(raw.quality), `range: quality ${raw.quality}`);
  text(raw.calibration, 64, "calibration");
  return batch;
}

function revision(raw) {
  const m = raw.sequences.length;
  check(2 <= m && m <= 1536, `length: ${m} points`);
  check(raw.timesNs.length === m, "length: times_ns");
  const found = {
    device: raw.device, boot: big(raw.boot), calibration: raw.calibration, matrix: vectors(raw.matrix),
    sequences: raw.sequences.map(big), times: raw.timesNs.map(big), bias: vectors(raw.bias), biasStd: vectors(raw.biasStd),
  };
  rising(found.sequences, MOST, "sequences");
  rising(found.times, MOST, "times_ns");
  whole(big(raw.timeNs), MOST, "time_ns");
  within(raw.matrix, 9, -10, 10, "matrix");
  within(raw.bias, 3 * m, -1000, 1000, "bias");
  within(raw.biasStd, 3 * m, 0, 1e6, "bias_std");
  text(raw.calibration, 64, "calibration");
  sentences(raw.reason, "reason");
  return found;
}

function sentences(said, name) {
  check(said.length <= 16, `${name}: ${said.length} sentences`);
  for (const { code, params } of said) {
    text(code, 64, name);
    check(Object.keys(params).length <= 8, `${name}: parameters of ${code}`);
    for (const [label, value] of Object.entries(params)) {
      text(label, 64, name);
      text(value, 500, name);
    }
  }
}

function windows(raw) {
  const m = raw.sequences.length;
  const [sequences, times] = [raw.sequences.map(big), raw.timesNs.map(big)];
  check(1 <= m && m <= 64, `length: ${m} windows`);
  check(times.length === m, "length: times_ns");
  rising(sequences, MOST, "sequences");
  rising(times, MOST, "times_ns");
  within([raw.windowS], 1, 1e-3, 60, "window_s");
  within(raw.samples, m, 1, 2 ** 20, "samples");
  for (const [of, most] of [["reading", 1000], ["rate", 2000]])
    for (const what of ["Mean", "Std", "Min", "Max"]) within(raw[of + what], 3 * m, what === "Std" ? 0 : -most, most, of + what);
  for (const name of ["noiseStd", "biasStd", "scaleStd", "crossStd"]) within(raw[name], 3, 0, 1e6, name);
  if (raw.flickerStd.length) within(raw.flickerStd, 3, 0, 1e6, "flickerStd");
  within(raw.bias, 3, -1000, 1000, "bias");
  check(raw.flags.length === 0 || raw.flags.length === m, "length: flags");
  for (const flags of raw.flags) check((flags & ~FLAGS) === 0, `range: flags ${flags}`);
  check(known("Quality").includes(raw.quality), `range: quality ${raw.quality}`);
  text(raw.calibration, 64, "calibration");
  return sequences.map((number, i) => {
    const noise = raw.noiseStd.map((value) => value / Math.sqrt(raw.samples[i]));
    const batch = { noise, scale: raw.scaleStd, cross: raw.crossStd, flicker: raw.flickerStd };
    const [mean, least, most] = [raw.rateMean, raw.rateMin, raw.rateMax].map((values) => values.slice(3 * i, 3 * i + 3));
    return {
      window: raw.device, boot: big(raw.boot), number, time_ns: times[i], samples: raw.samples[i], mean, least, most,
      mean_std: std(batch, mean, raw.biasStd), quality: raw.quality, flags: raw.flags[i] ?? 0,
    };
  });
}

const vectors = (flat) => Array.from({ length: flat.length / 3 }, (_, i) => Array.from(flat.slice(3 * i, 3 * i + 3)));
const time = (batch, i) =>
  batch.start + BigInt(Math.round(Number(batch.ticks[i] - batch.ticks[0]) * batch.period * batch.clock * 1e9));

function std(batch, rate, biasStd) {
  return rate.map((r, axis) => {
    const across = Math.hypot(...rate.filter((_, other) => other !== axis));
    const flicker = batch.flicker[axis] ?? 0;
    return Math.hypot(batch.noise[axis], biasStd[axis], flicker, r * batch.scale[axis], across * batch.cross[axis]);
  });
}

// Takes nothing of an older epoch after a newer one, which is forgotten when only older ones have come for five seconds.
const newest = new Map();
function current(device, epoch) {
  const known = newest.get(device);
  const now = performance.now();
  if (known !== undefined && epoch < known.epoch) {
    known.older ??= now;
    if (now - known.older <= 5000) return false;
  }
  newest.set(device, { epoch, older: undefined });
  return true;
}

// Takes each sample once: the number after the last one taken, and when the latest was, of each boot of each device.
const taken = new Map();
function first(batch) {
  const which = `${batch.device} ${batch.boot}`;
  const end = batch.sequence + BigInt(batch.ticks.length);
  const last = time(batch, batch.ticks.length - 1);
  let { next, latest } = taken.get(which) ?? { next: batch.sequence, latest: last };
  if (end <= next && batch.start > latest + 1_000_000_000n) next = batch.sequence; // started anew under its old boot number
  const known = next > batch.sequence ? Number(next - batch.sequence) : 0;
  taken.set(which, { next: next > end ? next : end, latest: latest > last ? latest : last });
  return Math.min(known, batch.ticks.length);
}

// What a revision says of sample i of a batch: [rate now, bias_std now], or nothing.
function revised(batch, i, by) {
  const number = batch.sequence + BigInt(i);
  const t = time(batch, i);
  const last = by.times.length - 1;
  const same = batch.device === by.device && batch.boot === by.boot && batch.calibration === by.calibration;
  if (!same || number < by.sequences[0] || number > by.sequences[last]) return null;
  if (t < by.times[0] - 1_000_000_000n || t > by.times[last] + 1_000_000_000n) return null;
  let k = by.times.findIndex((point) => point >= t);
  if (k < 0) k = last;
  const from = Math.max(0, k - 1);
  const part = k === from ? 0 : Math.min(1, Math.max(0, Number(t - by.times[from]) / Number(by.times[k] - by.times[from])));
  const at = (values) => values[from].map((value, axis) => value + part * (values[k][axis] - value));
  const change = at(by.bias).map((now, axis) => batch.bias[axis] - now);
  const std2 = at(by.biasStd).map((value) => value * value);
  const product = (row, vector) => row.reduce((sum, element, j) => sum + element * vector[j], 0);
  return [
    batch.rate[i].map((r, axis) => r + product(by.matrix[axis], change)),
    by.matrix.map((row) => Math.sqrt(product(row.map((element) => element * element), std2))),
  ];
}

const print = (found) => console.log(JSON.stringify(found, (_, value) => (typeof value === "bigint" ? value.toString() : value)));
const kept = [];

function take(key, payload) {
  const [what, raw] = open(key, payload);
  if (what === "corrected") {
    const batch = corrected(raw);
    if (!current(batch.device, batch.epoch)) return;
    for (let i = first(batch); i < batch.ticks.length; i++) {
      kept.push([batch, i]);
      print({
        device: batch.device, boot: batch.boot, number: batch.sequence + BigInt(i), time_ns: time(batch, i),
        device_time: Number(batch.ticks[i]) * batch.period, rate: batch.rate[i], rate_std: std(batch, batch.rate[i], batch.biasStd),
        quality: batch.quality, flags: raw.flags[i] ?? 0,
      });
    }
  } else if (what === "revision") {
    const by = revision(raw);
    for (const [batch, i] of kept) {
      const now = revised(batch, i, by);
      if (now === null) continue;
      const [rate, biasStd] = now;
      print({ revised: batch.device, boot: batch.boot, number: batch.sequence + BigInt(i), rate, rate_std: std(batch, rate, biasStd) });
    }
  } else if (what === "@windowed") windows(raw).forEach(print);
  else print({ status: raw.device, state: raw.state, samples_in: big(raw.samplesIn), reason: raw.reason.map((one) => [one.code, one.params]) });
}

const bytes = readFileSync(file);
for (let at = 0; at < bytes.length; ) {
  const [ofKey, ofPayload] = [bytes.readUInt32LE(at), bytes.readUInt32LE(at + 4)];
  const key = bytes.toString("utf8", at + 8, at + 8 + ofKey);
  at += 8 + ofKey + ofPayload;
  try {
    take(key, bytes.subarray(at - ofPayload, at));
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    print({ refused: key, why: error.message });
  }
}
