import { type MotionError, ProgramEnded, ProgramRejected, RequestRefused } from "./errors.js";
import { type Ack, type ContinueReply, type Diagnostic, ENDED, type Fault, type OpenReply, type ProgramState, type ProgramStatus, type SubmitReply } from "./messages.js";

const CHUNK_LINES = 1000;
const CHUNK_CHARACTERS = 64 * 1024;

/**
 * The numbering of one program's lines: a state machine without I/O or clock, for a client that has one message under way.
 *
 * The server takes line n only after line n - 1, acknowledges a repeat and never runs it again. So whatever is not known to be accepted may
 * be sent again, and must be until it is: nothing is lost and nothing runs twice (docs/wire/lines.md).
 */
export class LineWindow {
  accepted: number;
  done: number;
  credit: number;
  state: ProgramState;
  failure: MotionError | null = null;
  /** Something could not be placed: the server has to be asked before anything is sent. */
  stale = false;
  readonly #program: string;
  readonly #chunkLines: number;
  /** Lines given that are not known to be accepted: accepted + 1, accepted + 2, … */
  #waiting: string[] = [];
  #underWay = 0;
  /**
   * Rejections of lines that are known. Lines go out with this count, and the server takes none of before a rejection; what it says with a
   * smaller one is older than what is known.
   */
  #rejections = 0;
  /** Lines were given up while it was not known whether they had arrived: the server's number is the right one. */
  #adrift = false;

  constructor(opened: OpenReply | ContinueReply, chunkLines = CHUNK_LINES) {
    this.#program = opened.program;
    this.#chunkLines = chunkLines;
    this.accepted = opened.expected - 1;
    // of a program that goes on, lines that the server had already are not done
    this.done = "line" in opened ? opened.line - 1 : this.accepted;
    this.credit = opened.credit;
    this.state = opened.state;
  }

  get ended(): boolean { return ENDED.has(this.state); }
  /** Number of the last line given. */
  get given(): number { return this.accepted + this.#waiting.length; }
  /** Whether lines wait for their acceptance. */
  get pending(): boolean { return this.#waiting.length > 0; }
  /** Whether the fate of a message is not known. */
  get uncertain(): boolean { return this.#underWay > 0; }
  get adrift(): boolean { return this.#adrift; }

  give(line: string): number { this.#waiting.push(line); return this.given; }

  /** Clears a rejection that the program outlives, once the application has heard of it. */
  forgive(): void { if (this.failure instanceof ProgramRejected && !this.ended) this.failure = null; }

  /** The message to send now, within the credit; null where nothing waits, or one is under way. */
  next(): { first: number; lines: string[]; rejections: number } | null {
    if (this.#underWay > 0 || this.failure || this.ended) return null;
    let count = Math.min(this.#waiting.length, Math.max(0, this.credit), this.#chunkLines);
    let size = 0;
    for (let index = 0; index < count; index += 1) {
      size += this.#waiting[index]!.length;
      if (size > CHUNK_CHARACTERS && index > 0) count = index;
    }
    if (count === 0) return null;
    this.#underWay = count;
    return { first: this.accepted + 1, lines: this.#waiting.slice(0, count), rejections: this.#rejections };
  }

  /** Takes the reply to the message under way. */
  answered(reply: SubmitReply): void {
    this.#underWay = 0;
    // of a rejection that is not heard of the reply does not say which line it is
    this.stale ||= (reply.rejections ?? 0) > this.#rejections;
    this.#numbers(reply.rejections ?? 0, reply.accepted, reply.done, reply.credit);
    this.#leftOver();
  }

  /** Takes an error reply to the message under way; gives back what it does not mean for the lines themselves. */
  refused(refusal: RequestRefused): RequestRefused | null {
    const sent = this.#underWay;
    this.#underWay = 0;
    this.done = Math.max(this.done, wholeNumber(refusal.details["done"], 0));
    const rejections = wholeNumber(refusal.details["rejections"], this.#rejections);
    const accepted = wholeNumber(refusal.details["accepted"], this.accepted);
    // its line is given up, now or when an acknowledgement said so before
    if (refusal.diagnostics.length) this.#rejection(rejections, wholeNumber(refusal.details["expected"], accepted + 1), refusal.diagnostics);
    this.#numbers(rejections, accepted, this.done, wholeNumber(refusal.details["credit"], this.credit));
    if (refusal.diagnostics.length) return null;
    // of a program of an earlier start the server tells how far it came when it is asked
    if (refusal.code === "MC505" || refusal.code === "MC503") this.stale ||= !this.failure;
    else if (refusal.code === "MC510") {
      const state = String(refusal.details["state"] ?? "");
      if (ENDED.has(state)) this.#end(state as ProgramState, null, [], String(refusal.details["reason"] ?? ""));
      this.failure ??= this.#closed();
    } else {
      // such as MC519: whether the lines will be taken is not said
      this.#underWay = sent;
      return refusal;
    }
    return null;
  }

  /** Takes an acknowledgement, whenever one comes. */
  acknowledged(ack: Ack): void {
    if (ack.program !== this.#program) return;
    this.#report(ack);
    if (this.#isOld(ack)) return;
    this.#numbers(ack.rejections ?? 0, ack.accepted, ack.done, ack.credit);
    this.#enter(ack.state, ack.fault, ack.diagnostics ?? [], ack.reason);
    this.#leftOver();
  }

  /** Takes what the server says when it is asked; null: it knows no such program. Nothing is under way any more. */
  asked(status: ProgramStatus | null): void {
    this.#underWay = 0;
    this.stale = false;
    if (!status) { this.#end("interrupted"); return; }
    this.#report(status);
    if (this.#isOld(status)) return;
    if (this.#adrift && status.accepted > this.accepted) { this.accepted = status.accepted; this.#waiting = []; }
    this.#adrift = false;
    this.acknowledged(status);
    if ((status.rejections ?? 0) === this.#rejections && status.accepted < this.accepted && !this.failure) {
      this.failure = new ProgramEnded(this.state, "MC533", `the server has lines through ${status.accepted}, and had acknowledged ${this.accepted}`, "abort the program", status.accepted, this.done);
    }
  }

  /** Gives up the lines that wait. Those under way may arrive all the same. */
  abandon(): void {
    if (this.#underWay > 0) this.#adrift = this.stale = true;
    this.#waiting = [];
    this.#underWay = 0;
  }

  /** Takes how far the program is, unless a line has been rejected since, or one that is not heard of. */
  #numbers(rejections: number, accepted: number, done: number, credit: number): void {
    // older than what is known, or about lines that were never given
    if (rejections !== this.#rejections || accepted < this.accepted || accepted > this.given) return;
    this.#waiting.splice(0, accepted - this.accepted);
    this.#underWay = Math.max(0, this.#underWay - (accepted - this.accepted));
    this.accepted = accepted;
    this.done = Math.max(this.done, done);
    this.credit = credit;
  }

  /** Whether a report is from before a rejection that is known; that a program has ended is never too old. */
  #isOld(report: Ack): boolean { return (report.rejections ?? 0) < this.#rejections && !ENDED.has(report.state); }

  /** Takes the rejection that a report tells of, if it is not known yet. */
  #report({ rejections = 0, rejected = 0, accepted, diagnostics = [] }: Ack): void {
    if (rejections <= this.#rejections) return;
    this.#rejection(rejections, rejected || accepted + 1, diagnostics);
    if (!this.#adrift) return;
    // of the lines that were given up on their way these have arrived
    this.accepted = accepted;
    this.#waiting = [];
    this.#adrift = false;
  }

  /** Gives up a line that was found faulty, and what follows, where it is not given up yet. */
  #rejection(rejections: number, line: number, diagnostics: Diagnostic[]): void {
    if (rejections <= this.#rejections) return;
    this.#rejections = rejections;
    const lost = line <= this.given;
    this.#cut(line);
    if (lost) this.failure ??= faulty(line, diagnostics);
  }

  /** Gives up a line and all behind it: it is the next number. */
  #cut(line: number): void {
    this.#waiting.length = Math.min(this.#waiting.length, Math.max(0, line - 1 - this.accepted));
    this.#underWay = Math.min(this.#underWay, this.#waiting.length);
    this.accepted = Math.min(this.accepted, line - 1);
  }

  #enter(state: ProgramState, fault: Fault | null | undefined, diagnostics: Diagnostic[], reason?: string): void {
    if (this.ended) return;
    if (ENDED.has(state)) this.#end(state, fault, diagnostics, reason); else this.state = state;
  }

  #end(state: ProgramState, fault: Fault | null = null, diagnostics: Diagnostic[] = [], reason = ""): void {
    if (this.ended) return;
    this.state = state;
    if (state === "finished") return;
    if (state === "rejected") { this.failure = faulty(this.accepted + 1, diagnostics); return; }
    const code = state === "interrupted" ? "MC534" : fault ? fault.code : state === "faulted" ? "MC400" : "MC535";
    const message = state === "interrupted"
      ? `the server that ran the program went away; lines through ${this.done} are done, line ${this.done + 1} may have begun`
      : fault?.message ?? `the program was ${state}${reason && ` (${reason})`}; lines through ${this.done} are done`;
    const hint = state === "interrupted" ? `machine.continueProgram({ program: "${this.#program}" }) goes on` : fault?.hint ?? "";
    this.failure = new ProgramEnded(state, code, message, hint, this.accepted, this.done);
  }

  /** Lines wait for a program that has finished without them. */
  #leftOver(): void {
    if (this.state === "finished" && !this.failure && this.pending) { this.failure = this.#closed(); this.#waiting = []; }
  }

  #closed(): ProgramEnded {
    return new ProgramEnded(this.state, "MC536", `the program takes no more lines: it is ${this.state}`, "open another one", this.accepted, this.done);
  }
}

function faulty(line: number, diagnostics: Diagnostic[]): ProgramRejected {
  const first = diagnostics[0] ?? { code: "MC100", message: `line ${line} was rejected`, line };
  return new ProgramRejected(first.code, first.message, first.hint ?? "", { line }, diagnostics.length ? diagnostics : [first]);
}

function wholeNumber(value: unknown, otherwise: number): number { return typeof value === "number" ? value : otherwise; }
