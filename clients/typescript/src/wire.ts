import { MotionError } from "./errors.js";

/** Some cycles of every axis: `fields` by name, each with `rows` x `axes.length` numbers, row by row. */
export interface Samples {
  seq: number; t: number; cycleS: number; rows: number; axes: number[]; fields: Record<string, Float32Array>;
}

type Kind = "string" | "number" | "boolean" | "array" | "object";

const OPENED = { program: "string", state: "string", axes: "array", expected: "number", credit: "number", instance: "string" } as const;
/** Fields of the messages that decide about lines and places; `?` marks those that may be left out or nil. */
const FIELDS: Record<string, Record<string, Kind | `${Kind}?`>> = {
  Ack: {
    program: "string", accepted: "number", done: "number", credit: "number", state: "string",
    rejected: "number?", diagnostics: "array?", fault: "object?", expected: "number?", rejections: "number?", reason: "string?",
  },
  ProgramStatus: {
    program: "string", accepted: "number", done: "number", credit: "number", state: "string",
    rejected: "number?", diagnostics: "array?", fault: "object?", rejections: "number?", reason: "string?",
  },
  OpenReply: OPENED,
  ContinueReply: { ...OPENED, line: "number", resume_of: "string", whole: "boolean" },
  ServoReply: { program: "string", axes: "array" },
  SubmitReply: { program: "string", accepted: "number", done: "number", credit: "number", rejections: "number?" },
  CloseReply: { program: "string", accepted: "number", done: "number", state: "string" },
  ErrorReply: { code: "string", message: "string", hint: "string?", details: "object?", diagnostics: "array?" },
  Event: { seq: "number", t: "number", instance: "string", kind: "string" },
  Fault: { code: "string", message: "string" },
  Diagnostic: { code: "string", message: "string" },
};

/** The value as the message it should be, or MC533: whoever wrote it speaks another version. */
export function understand<T>(kind: string, value: unknown): T {
  const message = value as Record<string, unknown>;
  if (kindOf(value) !== "object") throw misunderstood(kind, "it is no map");
  for (const [name, wanted] of Object.entries(FIELDS[kind] ?? {})) {
    const found = message[name];
    if (found === undefined || found === null) {
      if (!wanted.endsWith("?")) throw misunderstood(kind, `${name} is missing`);
    } else if (kindOf(found) !== wanted.replace("?", "")) throw misunderstood(kind, `${name} is of another type`);
  }
  if (message["fault"]) understand("Fault", message["fault"]);
  for (const each of (message["diagnostics"] ?? []) as unknown[]) understand("Diagnostic", each);
  return value as T;
}

/** Rows of numbers by field, from the bytes of a block. */
export function columnsOf(block: unknown, axes: number, names: string[]): { seq: number; t: number; rows: number; fields: Record<string, Float32Array> } {
  if (!Array.isArray(block) || typeof block[0] !== "number" || typeof block[1] !== "number" || !(block[2] instanceof Uint8Array)) {
    throw misunderstood("TelemetryBlock", "it is no array of two numbers and bytes");
  }
  const bytes = block[2];
  const rows = bytes.length / (4 * axes * names.length);
  if (!Number.isInteger(rows)) throw misunderstood("TelemetryBlock", `${bytes.length} bytes are not whole rows`);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const fields: Record<string, Float32Array> = {};
  names.forEach((name, field) => {
    const column = (fields[name] = new Float32Array(rows * axes));
    for (let i = 0; i < column.length; i += 1) column[i] = view.getFloat32(4 * (i * names.length + field), true);
  });
  return { seq: block[0], t: block[1], rows, fields };
}

function kindOf(value: unknown): Kind | string {
  if (value === null) return "nil";
  if (Array.isArray(value)) return "array";
  return typeof value === "object" ? (value instanceof Uint8Array ? "bytes" : "object") : typeof value;
}

function misunderstood(kind: string, why: string): MotionError {
  return new MotionError("MC533", `this is no ${kind}: ${why}`, "do client and server differ in version?");
}

/** Half a character: no text has it, and MessagePack's strings cannot carry it. */
export const SURROGATE = /\p{Surrogate}/u;

/** Whether all strings of a value are text. */
export function isText(value: unknown): boolean {
  if (typeof value === "string") return !SURROGATE.test(value);
  if (Array.isArray(value)) return value.every(isText);
  if (value && typeof value === "object" && !ArrayBuffer.isView(value)) return Object.entries(value).every(([key, each]) => !SURROGATE.test(key) && isText(each));
  return true;
}
