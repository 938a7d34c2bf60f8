/** What machines and programs need of the connection to a gateway. */
export interface Connection {
  /** A frame with an answer; sent again after a lost connection. */
  request<T>(frame: Record<string, unknown>): Promise<T>;
  /** A frame without an answer, of which the next one is newer: lost where the connection is away or full. */
  put(frame: Record<string, unknown>): void;
  /** Delivers each message of a topic until the function that it returns is called; `onResumed` after a lost connection. */
  listen(machine: string, topic: string, deliver: (message: any) => void, onResumed?: () => void): Promise<() => void>;
  /** Emergency stop, on a connection of its own beside the one that is there. */
  estop(machine: string, reason?: string): Promise<void>;
}
