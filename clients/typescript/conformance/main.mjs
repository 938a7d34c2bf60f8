// The conformance program: main.mjs URL TOKEN stream FILE | watch N | jog AXIS VELOCITY MS | estop | events N; JSON on stdout.
import { readFileSync } from "node:fs";
import WebSocket from "ws";
import { Gateway, MotionError } from "../dist/index.js";

const [url, token, task, ...rest] = process.argv.slice(2);
const say = (value) => console.log(JSON.stringify(value));

try {
  const gateway = await Gateway.connect(url, { token, WebSocket });
  const machine = await gateway.machine();
  if (task === "stream") {
    const program = await machine.program({ name: rest[0], onDisconnect: "finish" });
    say({ program: program.id });
    await program.sendLines(readFileSync(rest[0], "utf8").split("\n").filter((line) => line));
    await program.finish();
    say({ state: program.state, accepted: program.accepted, done: program.done });
  } else if (task === "watch") {
    let seen = 0; let next = -1; let gaps = 0;
    for await (const samples of await machine.samples()) {
      if (next >= 0 && samples.seq !== next) gaps += 1;
      next = samples.seq + samples.rows;
      seen += samples.rows;
      if (seen >= Number(rest[0])) break;
    }
    say({ rows: seen, gaps });
  } else if (task === "jog") {
    await machine.jogWhile(Number(rest[0]), Number(rest[1]), AbortSignal.timeout(Number(rest[2])));
    say({ ok: true });
  } else if (task === "estop") {
    await machine.estop("conformance");
    say({ state: (await machine.status()).state });
  }
  gateway.close();
} catch (error) {
  if (!(error instanceof MotionError)) throw error;
  say({ code: error.code, message: error.message, hint: error.hint, diagnostics: error.diagnostics });
  process.exit(1);
}
process.exit(0);
