// The conformance program: main.mjs URL TOKEN stream FILE [PROGRAM] | cancel FILE | watch N | jog AXIS VELOCITY MS | estop | bench FILE;
// JSON on standard output, one object a line.
import { readFileSync } from "node:fs";
import WebSocket from "ws";
import { Gateway, MotionError } from "../dist/index.js";

const [url, token, task, ...rest] = process.argv.slice(2);
// a server that is killed needs so long at most to be there again
const PATIENCE_MS = 120_000;
const linesOf = (file) => readFileSync(file, "utf8").split("\n").filter((line) => line);
const say = (value) => console.log(JSON.stringify(value));

try {
  const gateway = await Gateway.connect(url, { token, WebSocket });
  const machine = await gateway.machine();
  if (task === "stream") {
    const [file, former] = rest;
    const show = ({ line, done, axes }) => say({ continuation: { line, done, axes: axes.length } });
    const program = former
      ? await machine.continueProgram({ program: former, way: true, on_disconnect: "finish" }, { show, patienceMs: PATIENCE_MS })
      : await machine.program({ name: file, on_disconnect: "finish" }, PATIENCE_MS);
    say({ program: program.id });
    const left = linesOf(file).slice(program.given);
    if (left.length) await program.sendLines(left);
    await program.finish();
    say({ state: program.state, accepted: program.accepted, done: program.done });
  } else if (task === "cancel") {
    // streams a file over and over, gives that up in the middle, and goes on with one line
    const lines = linesOf(rest[0]);
    const program = await machine.program();
    const stop = new AbortController();
    let fed = 0;
    function* endless() { for (;;) yield lines[Math.min(fed++, lines.length - 1)]; }
    const streaming = program.sendLines(endless(), stop.signal).catch((error) => { if (error !== stop.signal.reason) throw error; });
    await program.waitDone(lines.length);
    stop.abort();
    await streaming;
    const next = await program.send(lines.at(-1));
    const before = fed;
    await program.finish();
    say({ next, fed: before, fed_later: fed - before, accepted: program.accepted, done: program.done });
  } else if (task === "watch") {
    let seen = 0; let next = -1; let gaps = 0; let axes = 0;
    for await (const samples of await machine.samples()) {
      if (next >= 0 && samples.seq !== next) gaps += 1;
      next = samples.seq + samples.rows;
      seen += samples.rows;
      axes = samples.axes.length;
      if (seen >= Number(rest[0])) break;
    }
    say({ rows: seen, gaps, axes });
  } else if (task === "jog") {
    await machine.jogWhile(Number(rest[0]), Number(rest[1]), AbortSignal.timeout(Number(rest[2])));
    say({ ok: true });
  } else if (task === "estop") {
    await machine.estop("conformance");
    say({ state: (await machine.status()).state });
  } else if (task === "bench") {
    const program = await machine.program();
    let begun = performance.now();
    const count = await program.sendLines(linesOf(rest[0]));
    const streamed = (performance.now() - begun) / 1e3;
    await program.finish();
    const latencies = [];
    for (let i = 0; i < 300; i += 1) {
      begun = performance.now();
      await machine.status();
      latencies.push(performance.now() - begun);
    }
    latencies.sort((a, b) => a - b);
    let frames = 0; let rows = 0;
    begun = performance.now();
    for await (const samples of await machine.samples()) {
      frames += 1;
      rows += samples.rows;
      if (performance.now() - begun > 3000) break;
    }
    const took = (performance.now() - begun) / 1e3;
    say({ lines_per_s: count / streamed, status_p50_ms: latencies[150], frames_per_s: frames / took, rows_per_s: rows / took });
  }
  gateway.close();
} catch (error) {
  if (!(error instanceof MotionError)) throw error;
  say({ code: error.code, message: error.message, hint: error.hint, diagnostics: error.diagnostics, accepted: error.accepted, done: error.done });
  process.exit(1);
}
process.exit(0);
