import { decode, encode } from "@msgpack/msgpack";
import { METHODS } from "./calls.js";
import type { Connection } from "./connection.js";
import { MotionError, NobodyAnswers, refusal } from "./errors.js";
import { Machine } from "./machine.js";
import { isText, understand } from "./wire.js";

/** The part of a WebSocket that is used: the browser's own, or the class of the package `ws` in Node. */
export interface Socket {
  binaryType: string;
  onopen: ((event: any) => void) | null;
  onmessage: ((event: any) => void) | null;
  onclose: ((event: any) => void) | null;
  onerror: ((event: any) => void) | null;
  readonly bufferedAmount?: number;
  send(data: Uint8Array): void;
  close(code?: number): void;
}

export interface ConnectOptions {
  /** The secret token; none on the gateway's own computer. */
  token?: string;
  /** The WebSocket class; default: the global one. */
  WebSocket?: new (url: string, protocols: string[]) => Socket;
  signal?: AbortSignal;
  /** How long a call waits for its reply, lost connections included [ms]. */
  deadlineMs?: number;
}

interface Pending { frame: Record<string, unknown>; sent: boolean; resolve: (value: any) => void; reject: (error: Error) => void; timer: ReturnType<typeof setTimeout>; }
interface Listening { machine: string; topic: string; deliver: (message: any) => void; onResumed: () => void; }

const RETRY_MS = [50, 100, 200, 400, 800, 1000];
/** Too many calls at once: none of them was carried out. */
const TOO_MUCH = "MC071";
const BUSY_MS = 100;
/** What waits for the link where targets are dropped. */
const FULL_BYTES = 64 * 1024;
/** Code of a connection that the gateway ends for a frame that is none. */
const BAD_FRAME = 4000;
/** That it does not come back: its programs end now. */
const NORMAL_CLOSURE = 1000;

/**
 * One client of a gateway. A connection that breaks is made anew: calls without an answer are sent again with the same
 * number, so that nothing is done twice, and subscriptions are made again. Where the gateway no longer knows the client, calls that change
 * something and may have been carried out are not sent again: they fail with MC532.
 */
export class Gateway implements Connection {
  /** This client's id, as others see it in events. */
  client = "";
  role = "";
  #socket: Socket | null = null;
  #session = "";
  #greeted = false;
  #numbers = 0;
  #pending = new Map<number, Pending>();
  #listening = new Map<number, Listening>();
  #closed = false;
  #retries = 0;
  #ready: (() => void) | null = null;
  #refused: ((error: Error) => void) | null = null;

  private constructor(private readonly url: string, private readonly options: ConnectOptions) {}

  /** Connects, or fails with NobodyAnswers. `url` such as ws://127.0.0.1:8787/v1/ws. */
  static connect(url: string, options: ConnectOptions = {}): Promise<Gateway> {
    const gateway = new Gateway(url, options);
    options.signal?.addEventListener("abort", () => gateway.close(), { once: true });
    return new Promise((resolve, reject) => {
      gateway.#ready = () => resolve(gateway);
      gateway.#refused = reject;
      gateway.#open();
    });
  }

  /** Names of the machines that are there. */
  async machines(): Promise<string[]> { return this.request({ op: "machines" }); }

  /** A machine by name; without one the only one that is there. */
  async machine(name?: string): Promise<Machine> {
    if (name === undefined) {
      const names = await this.machines();
      if (names.length !== 1) throw new NobodyAnswers("MC531", `${names.length} machines are there: ${names.join(", ")}`, "name one");
      name = names[0]!;
    }
    return Machine.open(this, name);
  }

  /** Ends the connection; programs still open end as their on_disconnect says, without their grace. */
  close(): void {
    this.#closed = true;
    this.#socket?.close(NORMAL_CLOSURE);
    for (const pending of this.#pending.values()) {
      clearTimeout(pending.timer);
      pending.reject(new NobodyAnswers("MC539", "the client is closed"));
    }
    this.#pending.clear();
  }

  /** Emergency stop, on a connection of its own beside the one that is there; resolves once the server has confirmed one of them. */
  async estop(machine: string, reason = ""): Promise<void> {
    // one number for both copies: the later one does not stop again what has been reset meanwhile
    const request = 2 ** 32 + Math.floor(Math.random() * 2 ** 52);
    const stop = (gateway: Gateway): Promise<unknown> => gateway.request({ op: "estop", machine, reason, request });
    const apart = Gateway.connect(this.url, this.options).then((own) => stop(own).finally(() => own.close()));
    try { await Promise.any([stop(this), apart]); } catch (error) { throw error instanceof AggregateError ? error.errors[0] : error; }
  }

  /** A frame with an answer; sent again after a lost connection. */
  request<T>(frame: Record<string, unknown>): Promise<T> {
    if (this.#closed) return Promise.reject(new NobodyAnswers("MC539", "the client is closed"));
    if (!isText(frame)) return Promise.reject(new MotionError("MC538", "a text holds half a character (a lone surrogate)", "send whole characters"));
    const id = ++this.#numbers;
    const whole = frame["op"] === "call" ? { ...frame, id, request: id } : { ...frame, id };
    const limit = Math.max(this.options.deadlineMs ?? 15_000, 1000 * (METHODS[String(frame["method"])]?.deadlineS ?? 0));
    return new Promise<T>((resolve, reject) => {
      const timer = setTimeout(() => {
        this.#pending.delete(id);
        reject(new NobodyAnswers("MC532", `no answer to ${String(frame["method"] ?? frame["op"])} within ${limit / 1000} s`, "is the gateway running?"));
      }, limit);
      this.#pending.set(id, { frame: whole, sent: this.#connected, resolve, reject, timer });
      this.#send(whole);
    });
  }

  put(frame: Record<string, unknown>): void {
    if (this.#closed) throw new NobodyAnswers("MC539", "the client is closed");
    if ((this.#socket?.bufferedAmount ?? 0) < FULL_BYTES) this.#send(frame);
  }

  /** Delivers each message of a topic until the function that it returns is called; `onResumed` after a lost connection. */
  async listen(machine: string, topic: string, deliver: (message: any) => void, onResumed: () => void = () => {}): Promise<() => void> {
    const id = ++this.#numbers;
    this.#listening.set(id, { machine, topic, deliver, onResumed });
    await new Promise<void>((resolve, reject) => {
      const timer = setTimeout(() => reject(new NobodyAnswers("MC532", `no answer to subscribe ${topic}`)), this.options.deadlineMs ?? 15_000);
      const frame = { op: "subscribe", id, machine, topic };
      this.#pending.set(id, { frame, sent: this.#connected, resolve: () => resolve(), reject, timer });
      this.#send(frame);
    });
    return () => { if (this.#listening.delete(id)) this.#send({ op: "unsubscribe", id }); };
  }

  get #connected(): boolean { return this.#socket !== null && this.#greeted; }

  #open(): void {
    const Kind = this.options.WebSocket ?? (globalThis as { WebSocket?: ConnectOptions["WebSocket"] }).WebSocket;
    if (!Kind) { this.#refused?.(new MotionError("MC537", "there is no WebSocket here", "give connect({ WebSocket }) the one of the package ws")); return; }
    const protocols = ["mc.v1", ...(this.options.token ? [`mc.token.${this.options.token}`] : [])];
    const socket = new Kind(this.#session ? `${this.url}?session=${encodeURIComponent(this.#session)}` : this.url, protocols);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.#receive(decode(new Uint8Array(event.data as ArrayBuffer)) as Record<string, any>);
    socket.onerror = () => {};
    socket.onclose = (event) => {
      if (event?.code === BAD_FRAME) this.#refuseSent(String(event?.reason ?? ""));
      this.#lost(String(event?.reason ?? ""));
    };
    this.#socket = socket;
  }

  /** The gateway could not read a frame: one of those that were sent, which would not be read the next time either. */
  #refuseSent(reason: string): void {
    for (const [id, pending] of this.#pending) {
      if (!pending.sent) continue;
      this.#pending.delete(id);
      clearTimeout(pending.timer);
      pending.reject(new MotionError("MC533", `the gateway cannot read what was sent: ${reason}`, "client and gateway differ in version"));
    }
  }

  #lost(reason: string): void {
    this.#socket = null;
    this.#greeted = false;
    if (this.#closed) return;
    if (!this.#session) {
      this.#closed = true;
      this.#refused?.(new NobodyAnswers("MC530", `the gateway at ${this.url} refuses the connection or is not there${reason ? `: ${reason}` : ""}`, "is it running, and is the token right?"));
      return;
    }
    setTimeout(() => { if (!this.#closed) this.#open(); }, RETRY_MS[Math.min(this.#retries++, RETRY_MS.length - 1)]);
  }

  #receive(frame: Record<string, any>): void {
    if (frame["op"] === "hello") {
      const again = this.#session !== "";
      this.client = frame["client"]; this.role = frame["role"]; this.#session = frame["session"]; this.#retries = 0; this.#greeted = true;
      this.#ready?.(); this.#ready = null;
      if (!again) return;
      for (const [id, each] of this.#listening) if (!this.#pending.has(id)) this.#send({ op: "subscribe", id, machine: each.machine, topic: each.topic });
      for (const [id, pending] of this.#pending) {
        const what = String(pending.frame["method"] ?? pending.frame["op"]);
        if (!frame["resumed"] && pending.sent && pending.frame["op"] === "call" && !METHODS[what]?.repeatable) {
          this.#pending.delete(id);
          clearTimeout(pending.timer);
          pending.reject(new NobodyAnswers("MC532", `the gateway no longer knows this client: whether ${what} was carried out is not known`, "look at the machine's status before doing it again"));
        } else { pending.sent = true; this.#send(pending.frame); }
      }
      for (const each of this.#listening.values()) each.onResumed();
    } else if (frame["op"] === "message") {
      this.#listening.get(frame["id"])?.deliver(frame["message"]);
    } else if (frame["op"] === "reply") {
      const pending = this.#pending.get(frame["id"]);
      if (!pending) return;
      if (!frame["ok"] && frame["error"]?.code === TOO_MUCH) {
        setTimeout(() => { if (this.#pending.get(frame["id"]) === pending) this.#send(pending.frame); }, BUSY_MS);
        return;
      }
      this.#pending.delete(frame["id"]);
      clearTimeout(pending.timer);
      if (frame["ok"]) pending.resolve(frame["value"]); else pending.reject(reason(frame["error"]));
    }
  }

  #send(frame: Record<string, unknown>): void {
    // what is not sent now is sent by the next connection
    if (this.#socket && this.#greeted) { try { this.#socket.send(encode(frame)); } catch { /* it is closing */ } }
  }
}

function reason(error: unknown): MotionError {
  try { return refusal(understand("ErrorReply", error)); } catch (misunderstood) { return misunderstood as MotionError; }
}
