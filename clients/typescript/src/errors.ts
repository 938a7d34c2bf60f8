import type { Diagnostic } from "./messages.js";

/** Base of all errors: a stable code such as MC505, a sentence, and the remedy. */
export class MotionError extends Error {
  constructor(
    readonly code: string, message: string, readonly hint = "",
    readonly details: Record<string, unknown> = {}, readonly diagnostics: Diagnostic[] = [],
  ) {
    super(message);
    this.name = new.target.name;
  }
}

/** The server refuses a request; the state is as it was before. */
export class RequestRefused extends MotionError {}

/** Nothing answers: the gateway, the machine, or within the time. */
export class NobodyAnswers extends MotionError {}

/** A line has faults; nothing of it moved. `diagnostics` has line and column. */
export class ProgramRejected extends MotionError {}

/** The program ended otherwise than finished: aborted, faulted, interrupted. */
export class ProgramEnded extends MotionError {
  /** `accepted` and `done` are numbers of lines: those through `done` have ended, the one after it may have begun. */
  constructor(
    readonly state: string, code: string, message: string, hint = "", readonly accepted = 0, readonly done = 0,
  ) { super(code, message, hint); }
}

export function refusal(error: { code: string; message: string; hint?: string; details?: Record<string, unknown>; diagnostics?: Diagnostic[] }): MotionError {
  const kind = error.code === "MC530" || error.code === "MC532" ? NobodyAnswers : RequestRefused;
  return new kind(error.code, error.message, error.hint ?? "", error.details ?? {}, error.diagnostics ?? []);
}
