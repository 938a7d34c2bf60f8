// What a client does when its connection breaks, against a gateway that speaks frames and nothing else.
import assert from "node:assert/strict";
import { once } from "node:events";
import { test } from "node:test";
import { decode, encode } from "@msgpack/msgpack";
import WebSocket, { WebSocketServer } from "ws";
import { Gateway } from "../dist/index.js";

/** Answers `info`; every other frame is given to `answer`, whose undefined is no answer. */
async function fakeGateway(t, answer) {
  const server = new WebSocketServer({ port: 0, host: "127.0.0.1", handleProtocols: () => "mc.v1" });
  await once(server, "listening");
  const fake = { frames: [], connections: 0, resumed: true, cut: () => { for (const each of server.clients) each.terminate(); }, refuse: (code, reason) => { for (const each of server.clients) each.close(code, reason); } };
  server.on("connection", (socket, request) => {
    fake.connections += 1;
    const resumed = fake.resumed && request.url.includes("session=");
    socket.send(encode({ op: "hello", client: "c", session: "s", role: "operator", resumed, grace_s: 10, protocol: 1 }));
    socket.on("message", (bytes) => {
      const frame = decode(bytes);
      const info = { machine: "cell", instance: "i", cycle_s: 0.001, telemetry: { axes: [0], fields: ["setpoint"] } };
      const value = frame.method === "info" ? info : (fake.frames.push(frame), answer(frame, fake));
      if (value !== undefined) socket.send(encode({ op: "reply", id: frame.id, ok: !value?.code, value, error: value }));
    });
  });
  const gateway = await Gateway.connect(`ws://127.0.0.1:${server.address().port}/`, { WebSocket, deadlineMs: 10_000 });
  t.after(() => { gateway.close(); fake.cut(); server.close(); });
  return [await gateway.machine("cell"), fake];
}

test("a call without an answer is sent again under its number", async (t) => {
  const [machine, fake] = await fakeGateway(t, (frame, made) => {
    if (made.frames.length > 1) return { program: "j-1" };
    setImmediate(made.cut);
    return undefined;
  });
  assert.deepEqual(await machine.jog({ axis: 0, distance: 5 }), "j-1");
  assert.equal(fake.frames[0].request, fake.frames[1].request);
});

test("a motion is not asked for twice of a gateway that has forgotten the client", async (t) => {
  const [machine, fake] = await fakeGateway(t, (frame, made) => { made.resumed = false; setImmediate(made.cut); return undefined; });
  await assert.rejects(machine.jog({ axis: 0, distance: 5 }), { code: "MC532" });
  assert.equal(fake.frames.length, 1);
});

test("too many calls at once wait", async (t) => {
  const [machine] = await fakeGateway(t, (frame, made) => (made.frames.length > 2 ? { program: "j-1" } : { code: "MC071", message: "too many calls" }));
  assert.deepEqual(await machine.jog({ axis: 0, distance: 5 }), "j-1");
});

test("an emergency stop goes over a connection of its own where the first one says nothing", async (t) => {
  const [machine, fake] = await fakeGateway(t, (frame, made) => (made.frames.length > 1 ? null : undefined));
  await machine.estop("test");
  assert.equal(fake.connections, 2);
});

test("nothing goes on where what is shown is not wanted", async (t) => {
  const [machine, fake] = await fakeGateway(t, () => ({ line: 7 }));
  await assert.rejects(machine.continueProgram({ program: "p" }, { show({ line }) { throw new Error(`not from line ${line}`); } }), /line 7/);
  assert.deepEqual(fake.frames.map((each) => each.method), ["continuation"]);
});

/** A fake that opens a program and takes its lines. */
function taking(made) {
  made.lines = [];
  return (frame) => {
    if (frame.method === "open") return { program: "p", state: "running", axes: [0], expected: 1, credit: 100, instance: "i" };
    if (frame.op === "subscribe") return null;
    if (frame.method !== "submit") return { programs: [] };
    made.lines.push(...frame.params.lines);
    return { program: "p", accepted: made.lines.length, done: made.lines.length, credit: 100, rejections: 0 };
  };
}

test("lines go out while their source waits for them to be accepted", async (t) => {
  const made = {};
  const [machine] = await fakeGateway(t, taking(made));
  const program = await machine.program();
  async function* slow() {
    for (const line of ["G01 X1", "G01 X2", "G01 X3"]) {
      yield line;
      while (made.lines.at(-1) !== line) await new Promise((resolve) => setImmediate(resolve));
    }
  }
  assert.equal(await program.sendLines(slow()), 3);
});

test("a stream that is aborted while its source waits feeds nothing more", async (t) => {
  const made = {};
  const [machine] = await fakeGateway(t, taking(made));
  const program = await machine.program();
  const stop = new AbortController();
  let closed = false;
  async function* endless() {
    try {
      yield "G01 X1";
      stop.abort(new Error("enough"));
      await new Promise(() => {});
    } finally { closed = true; }
  }
  await assert.rejects(program.sendLines(endless(), stop.signal), /enough/);
  assert.deepEqual(made.lines.length <= 1, true);
  assert.equal(closed, false, "a source that waits for ever cannot be closed, and is not waited for");
});

test("a line that was found faulty late is given again once that has been heard of", async (t) => {
  const made = {};
  const take = taking(made);
  const faulty = { program: "p", state: "running", accepted: 0, done: 0, credit: 100, rejected: 1, rejections: 1, diagnostics: [{ code: "MC101", message: "faulty", line: 1 }] };
  const [machine] = await fakeGateway(t, (frame) => {
    if (frame.method === "programs") { made.lines = []; return { programs: [faulty] }; }
    const reply = take(frame);
    return frame.method === "submit" ? { ...reply, rejections: frame.params.rejections } : reply;
  });
  const program = await machine.program();
  await program.send("GO1 X1");
  await assert.rejects(program.waitDone(2), { code: "MC101" });
  assert.equal(program.failure?.code, "MC101");
  assert.equal(await program.send("G01 X1"), 1);
  assert.deepEqual([program.failure, made.lines], [null, ["G01 X1"]]);
});

test("a line of half a character is refused before it is sent", async (t) => {
  const made = {};
  const [machine, fake] = await fakeGateway(t, taking(made));
  const program = await machine.program();
  await assert.rejects(program.send("(\ud800)"), { code: "MC538" });
  await assert.rejects(machine.call("estop", { reason: "\udc00" }), { code: "MC538" });
  assert.equal(fake.connections, 1);
  assert.equal(await program.send("(\ud83d\ude00)"), 1);
});

test("a frame that the gateway cannot read is not sent again", async (t) => {
  const [machine, fake] = await fakeGateway(t, (frame, made) => { made.refuse(4000, "not a frame"); return undefined; });
  await assert.rejects(machine.hold(), { code: "MC533" });
  assert.equal(fake.frames.length, 1);
});
