// ZeroMQ over plain TCP: a client of ZMTP 3.0 with the NULL mechanism, in one file and without a library.
// https://rfc.zeromq.org/spec/23/ is the protocol; docs/wire-protocol.md says what tickfix sends over it.

import { EventEmitter } from "node:events";
import net from "node:net";

const MORE = 1, LONG = 2, COMMAND = 4;
const GREETING = Buffer.alloc(64);
GREETING.set([0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0x7f, 3, 0]);
GREETING.write("NULL", 12, "ascii");

/**
 * One connection to a ZeroMQ socket.
 *
 * Emits "ready" when messages may be sent, "message" with an array of Buffers, and "close" with a reason, once.
 */
export class Connection extends EventEmitter {
  /** @param {string} address such as tcp://127.0.0.1:5571  @param {"DEALER"|"SUB"} socketType */
  constructor(address, socketType) {
    super();
    const parts = /^tcp:\/\/\[?([^\]]+?)\]?:(\d+)$/.exec(address);
    if (!parts) throw new Error(`address: found ${address}; expected one such as tcp://127.0.0.1:5571`);
    this.socketType = socketType;
    this.received = Buffer.alloc(0);
    this.frames = [];
    this.greeted = this.isReady = false;
    this.socket = net.connect({ host: parts[1], port: Number(parts[2]), noDelay: true });
    this.socket.on("connect", () => this.socket.write(GREETING));
    this.socket.on("data", (bytes) => this.#take(bytes));
    let reason = "the other side closed";
    this.socket.on("error", (error) => (reason = error.message));
    this.socket.on("close", () => this.emit("close", reason));
  }

  /** Send one message of one or more frames. */
  send(...frames) {
    frames.forEach((frame, i) => this.#write(i + 1 < frames.length ? MORE : 0, frame));
  }

  /** Hear what is published under topics that begin with this prefix; for SUB. */
  subscribe(prefix) {
    this.send(Buffer.concat([Buffer.of(1), Buffer.from(prefix)]));
  }

  close() {
    this.socket.destroy();
  }

  #write(flags, body) {
    const long = body.length > 255;
    const head = Buffer.alloc(long ? 9 : 2);
    head[0] = flags | (long ? LONG : 0);
    if (long) head.writeBigUInt64BE(BigInt(body.length), 1);
    else head[1] = body.length;
    this.socket.write(Buffer.concat([head, body]));
  }

  #take(bytes) {
    this.received = Buffer.concat([this.received, bytes]);
    if (!this.greeted) {
      if (this.received.length < GREETING.length) return;
      if (this.received[0] !== 0xff || this.received[10] < 3) return this.socket.destroy(new Error("no ZMTP 3 peer"));
      this.received = this.received.subarray(GREETING.length);
      this.greeted = true;
      this.#write(COMMAND, Buffer.concat([text("READY"), text("Socket-Type"), longText(this.socketType)]));
    }
    for (let frame = this.#nextFrame(); frame; frame = this.#nextFrame()) {
      if (frame.flags & COMMAND) this.#handleCommand(frame.body);
      else {
        this.frames.push(frame.body);
        if (!(frame.flags & MORE)) this.emit("message", this.frames.splice(0));
      }
    }
  }

  #nextFrame() {
    const long = this.received[0] & LONG;
    const begin = long ? 9 : 2;
    if (this.received.length < begin) return null;
    const end = begin + (long ? Number(this.received.readBigUInt64BE(1)) : this.received[1]);
    if (this.received.length < end) return null;
    const frame = { flags: this.received[0], body: Buffer.from(this.received.subarray(begin, end)) };
    this.received = this.received.subarray(end);
    return frame;
  }

  #handleCommand(command) {
    const name = command.toString("ascii", 1, 1 + command[0]);
    if (name === "READY") {
      this.isReady = true;
      this.emit("ready");
    }
    // After the name, PING has two bytes of patience, and a context that PONG gives back.
    if (name === "PING") this.#write(COMMAND, Buffer.concat([text("PONG"), command.subarray(7)]));
    if (name === "ERROR") this.socket.destroy(new Error(`refused: ${command.toString("ascii", 7)}`));
  }
}

function text(value) {
  return Buffer.concat([Buffer.of(value.length), Buffer.from(value, "ascii")]);
}

function longText(value) {
  const length = Buffer.alloc(4);
  length.writeUInt32BE(value.length);
  return Buffer.concat([length, Buffer.from(value, "ascii")]);
}
