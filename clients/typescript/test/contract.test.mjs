// Plays the contract (clients/contract) without a network: node --test
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { decode } from "@msgpack/msgpack";
import { columnsOf, LineWindow, MotionError, ProgramRejected, RequestRefused, Servo, understand } from "../dist/index.js";

const folder = new URL("../../contract/", import.meta.url);
const read = (name) => JSON.parse(readFileSync(new URL(name, folder), "utf8"));
const bytes = (hex) => Uint8Array.from(Buffer.from(hex, "hex"));
const KINDS = ["Ack", "ProgramStatus", "OpenReply", "ContinueReply", "SubmitReply", "CloseReply", "ErrorReply", "Event", "ServoReply"];
const GARBAGE = read("garbage.json").refused;
// this SDK hands on what it does not use itself: of these kinds only some fields are looked at, and texts are decoded leniently
const LENIENT = /no UTF-8|^t is|maps, 3000 deep/;
const STRICT = ["Ack", "OpenReply", "ContinueReply", "SubmitReply", "CloseReply", "ErrorReply"];

/** Whether all that was decoded is what the contract says; keys that it does not name are later ones. */
function covers(found, wanted) {
  if (found instanceof Uint8Array) return Buffer.from(found).toString("base64") === wanted;
  if (Array.isArray(found)) return Array.isArray(wanted) && found.length === wanted.length && found.every((each, i) => covers(each, wanted[i]));
  if (found !== null && typeof found === "object") return Object.entries(found).every(([key, each]) => !(key in wanted) || covers(each, wanted[key]));
  return Object.is(found, wanted) || Math.abs(found) > Number.MAX_SAFE_INTEGER && Number(found) === wanted;
}

for (const kind of KINDS) {
  test(`every vector of ${kind} is read as its value`, () => {
    const file = read(`messages/${kind}.json`);
    for (const vector of [...file.vectors, ...(file.later_words ?? [])]) {
      assert.ok(covers(understand(kind, decode(bytes(vector.bytes))), vector.value), vector.name);
    }
  });
}

for (const kind of STRICT) {
  test(`what is no ${kind} is refused`, () => {
    for (const vector of [...GARBAGE, ...read(`messages/${kind}.json`).refused]) {
      if (!LENIENT.test(vector.name)) assert.throws(() => understand(kind, decode(bytes(vector.bytes))), vector.name);
    }
  });
}

test("samples are read column by column", () => {
  const file = read("telemetry.json");
  for (const vector of file.vectors) {
    const made = columnsOf(decode(bytes(vector.bytes)), vector.axes.length, file.fields);
    assert.deepEqual([made.seq, made.t, made.rows], [vector.seq, vector.t, vector.rows]);
    for (const name of file.fields) assert.deepEqual([...made.fields[name]], vector.columns[name]);
  }
  for (const vector of file.refused) assert.throws(() => columnsOf(decode(bytes(vector.bytes)), vector.axes.length, file.fields), MotionError);
});

const steps = {
  open(play, message) { play.window = new LineWindow(play.message("OpenReply", message), play.chunk); },
  continues(play, message) { play.window = new LineWindow(play.message("ContinueReply", message), play.chunk); },
  give(play, lines) { for (const line of lines) play.window.give(line); },
  judge(play, line) { play.window.give(line); },
  sends(play, wanted) { assert.deepEqual(play.window.next(), wanted); },
  quiet(play) { assert.equal(play.window.next(), null); },
  lost() {},
  ack(play, message) { play.window.acknowledged(play.message("Ack", message)); },
  asked(play, message) { play.window.asked(message && play.message("ProgramStatus", message)); },
  closes(play, { last }) { assert.equal(play.window.accepted, last); play.closing = true; },
  answer(play, answer) {
    if (play.closing) { play.closing = false; return; }
    if (answer.refused) {
      const error = play.message("ErrorReply", answer.refused);
      assert.equal(play.window.refused(new RequestRefused(error.code, error.message, error.hint, error.details ?? {}, error.diagnostics ?? [])), null);
    } else play.window.answered(play.message("SubmitReply", answer.reply));
  },
  knows(play, { accepted, done, state }) { assert.deepEqual({ accepted: play.window.accepted, done: play.window.done, state: play.window.state }, { accepted, done, state }); },
  fails(play, { code, line, column, says = "" }) {
    const failure = play.window.failure;
    assert.equal(failure?.code, code);
    assert.ok(failure.message.includes(says), failure.message);
    if (line) assert.ok(failure instanceof ProgramRejected && failure.diagnostics[0].line === line && failure.diagnostics[0].column === column);
    // from here on the application knows
    play.window.forgive();
  },
};

for (const name of readdirSync(new URL("sequences/", folder))) {
  const sequence = read(`sequences/${name}`);
  if (sequence.puts_only) continue;
  test(`the sequence "${sequence.name}" goes as the contract says`, () => {
    const play = { chunk: sequence.chunk_lines, message: (kind, { bytes: hex }) => understand(kind, decode(bytes(hex))) };
    sequence.steps.forEach((step, number) => {
      const [[what, value]] = Object.entries(step);
      try { steps[what](play, value); } catch (error) { error.message = `step ${number}, ${what}: ${error.message}`; throw error; }
    });
  });
}

/** A machine whose calls and frames the script answers. */
function scripted(play) {
  const gateway = {
    put: (frame) => play.put.push(frame),
    listen: async (machine, topic, deliver) => { play.deliver = deliver; return () => {}; },
  };
  const machine = {
    name: "cell",
    openServo: async () => { if (play.refusal) throw play.refusal; return play.opened; },
    programs: async () => [play.status],
  };
  return Servo.open(gateway, machine, {}, 0.1, () => play.now);
}

const servoSteps = {
  async servo(play, message) { play.opened = play.message("ServoReply", message); play.servo = await scripted(play); },
  async refused(play, message) {
    const { code, message: why, hint } = play.message("ErrorReply", message);
    play.refusal = new RequestRefused(code, why, hint);
    play.failed = await scripted(play).catch((error) => error);
  },
  targets(play, { sent, counts_s: countsS, positions, velocities, times, tool, frame }) {
    play.now = sent;
    try { play.servo.send({ countsS, positions: positions ?? undefined, velocities: velocities ?? undefined, times: times ?? undefined, tool: tool ?? undefined, frame }); } catch (error) { play.failed = error; }
  },
  puts(play, wanted) { assert.deepEqual(play.put.shift(), { op: "targets", machine: "cell", program: play.servo.id, message: wanted }); },
  lost() {},
  asked(play, message) { play.status = play.message("ProgramStatus", message); },
  async counts(play, wanted) {
    const { servo } = await play.servo.status();
    for (const [name, count] of Object.entries(wanted)) assert.equal(servo[name], count, name);
  },
  ack(play, { bytes: hex }) { play.deliver(decode(bytes(hex))); },
  knows(play, { state }) { assert.equal(play.servo.state, state); },
  fails(play, { code, says }) {
    assert.equal(play.failed?.code, code);
    assert.ok(play.failed.message.includes(says), play.failed.message);
    assert.deepEqual(play.put, []);
  },
};

for (const name of readdirSync(new URL("targets/", folder))) {
  const sequence = read(`targets/${name}`);
  test(`servo mode, "${sequence.name}", goes as the contract says`, async () => {
    const play = { put: [], message: (kind, { bytes: hex }) => understand(kind, decode(bytes(hex))) };
    for (const [number, step] of sequence.steps.entries()) {
      const [[what, value]] = Object.entries(step);
      try { await servoSteps[what](play, value); } catch (error) { error.message = `step ${number}, ${what}: ${error.message}`; throw error; }
    }
  });
}
