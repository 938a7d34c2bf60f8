/** Client of the open motion server for browsers and Node, through its gateway (docs/gateway.md). */
export { MotionError, NobodyAnswers, ProgramEnded, ProgramRejected, RequestRefused } from "./errors.js";
export { MachineCalls } from "./calls.js";
export { Feed } from "./feed.js";
export { type ConnectOptions, Gateway, type Socket } from "./gateway.js";
export { Machine } from "./machine.js";
export * from "./messages.js";
export { type ContinueOptions, Program } from "./program.js";
export { Servo, type Targets } from "./servo.js";
export { LineWindow } from "./window.js";
export { type Samples, columnsOf, understand } from "./wire.js";
