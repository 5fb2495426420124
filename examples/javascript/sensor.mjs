// A phone that lies on a table: 50 samples a second of two sensors and a scan every two seconds, sent to an engine.
//
//     node sensor.mjs tcp://127.0.0.1:5571 phone-17 [MESSAGES] [PERIOD_MS]
//
// Every message is numbered, kept until it is acknowledged, and sent again when it was not, be it that the connection
// broke, the engine died, or it was busy. Ends when MESSAGES (by default 50) are acknowledged.

import { randomBytes } from "node:crypto";
import { decode, encode } from "./messagepack.mjs";
import { Connection } from "./zmtp.mjs";

const [address, device, messages = "50", period = "200"] = process.argv.slice(2);
if (!device) {
  console.error("usage: node sensor.mjs ADDRESS DEVICE [MESSAGES] [PERIOD_MS]");
  process.exit(2);
}
const count = Number(messages), periodMs = Number(period);
const RESEND_MS = 2000, RECONNECT_MS = 200, WINDOW = 24;
const SAMPLES = 10, SAMPLE_NS = 20_000_000n;
// Another session for another run: numbers begin at 1 again.
const session = randomBytes(8).toString("hex");
const kept = new Map(); // number → { bytes, dueMs }
const outcomes = {};
let connection, last = 0;

function connect() {
  connection = new Connection(address, "DEALER");
  connection.on("ready", () => {
    const sensors = { accelerometer: 50, gyroscope: 50 };
    connection.send(encode({ v: 1, type: "hello", device, session, sensors, software: "sensor.mjs", clock: "boot" }));
    // What was under way on the old connection may be lost.
    for (const message of kept.values()) message.dueMs = 0;
    sendDue();
  });
  connection.on("message", (frames) => take(decode(frames.at(-1))));
  connection.on("close", (reason) => {
    if (finished()) return;
    console.error(`no connection to ${address}: ${reason}`);
    setTimeout(connect, RECONNECT_MS);
  });
}

function take(answer) {
  if (answer.type === "welcome") console.error(`welcome to ${answer.site}, run ${answer.run}`);
  if (answer.type === "error") console.error(`${answer.field}: found ${answer.found}; expected ${answer.expected}`);
  const message = answer.session === session && kept.get(answer.seq);
  if (!message || !["ack", "error"].includes(answer.type)) return;
  outcomes[answer.outcome] = (outcomes[answer.outcome] ?? 0) + 1;
  if (["busy", "throttled"].includes(answer.outcome)) message.dueMs = Date.now() + RESEND_MS;
  else kept.delete(answer.seq);
  if (!finished()) return sendDue();
  console.log(JSON.stringify({ device, session, sent: last, outcomes }));
  connection.close();
  clearInterval(measuring);
  clearInterval(resending);
}

function finished() {
  return last === count && kept.size === 0;
}

function sendDue() {
  if (!connection.isReady || connection.socket.destroyed) return;
  const now = Date.now();
  // Few at a time: the engine holds 32 answers for a connection, and those beyond are lost.
  const end = (kept.keys().next().value ?? 0) + WINDOW;
  for (const [seq, message] of kept) {
    if (seq >= end) break;
    if (message.dueMs > now) continue;
    connection.send(message.bytes);
    message.dueMs = now + RESEND_MS;
  }
}

function keep(fields) {
  last += 1;
  kept.set(last, { bytes: encode({ v: 1, device, session, seq: last, ack: true, ...fields }), dueMs: 0 });
  sendDue();
}

function measure() {
  if (last === count) return;
  const nowNs = process.hrtime.bigint();
  if (last % 10 === 9) {
    const heard_ns = [nowNs, nowNs - 300_000_000n];
    return keep({ type: "scan", transmitters: ["aa:bb:cc:00:00:01", "aa:bb:cc:00:00:02"], rssi_dbm: [-52, -71.5], heard_ns });
  }
  const t = Array.from({ length: SAMPLES }, (_, i) => nowNs - BigInt(SAMPLES - 1 - i) * SAMPLE_NS);
  // Arrays either way: the gyroscope's are lists, the accelerometer's bin of little-endian numbers, which is cheaper.
  const resting = Float64Array.from(t.flatMap(() => [0, 0, 9.81]));
  const gyroscope = { t_ns: t, values: t.map(() => [0, -0, 0.001]) };
  const accelerometer = { t_ns: bin(BigInt64Array.from(t)), values: bin(resting) };
  keep({ type: "motion", sensors: { accelerometer, gyroscope } });
}

function bin(array) {
  return new Uint8Array(array.buffer);
}

const measuring = setInterval(measure, periodMs);
const resending = setInterval(sendDue, RESEND_MS / 4);
connect();
