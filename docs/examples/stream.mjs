// Prints the corrected rates of one device: device, sample number, time (s since 1970), x, y, z (rad/s).
//   node stream.mjs http://127.0.0.1:8090 chest 1000
// Node 18 or newer, no packages. docs/stream.md explains the requests.
const [url, device, samples = "Infinity"] = process.argv.slice(2);
let left = Number(samples);
let after = []; // where the next request resumes
while (left > 0) {
  const asked = new URLSearchParams([["device", device], ...after.map((place) => ["after", place])]);
  const answer = await fetch(`${url}/api/v1/stream?${asked}`).catch(() => ({ status: 503 }));
  if (answer.status === 503) { // the dashboard is away or just starts
    await new Promise((resolve) => setTimeout(resolve, 1000));
    continue;
  }
  const said = await answer.json();
  if (!answer.ok) {
    console.error(said.error.message);
    process.exit(1);
  }
  for (const one of said.documents) {
    if (one.type === "missed") {
      console.error(`${one.device}: ${one.count ?? "unknown"} samples missed from number ${one.first}`);
      continue;
    }
    one.rate_rad_s.forEach((rate, i) => console.log([one.device, one.sequence + i, one.time_s[i], ...rate].join(",")));
    left -= one.rate_rad_s.length;
  }
  after = said.after;
}
