// Hears estimates and prints them, a line of JSON each.
//
//     node listener.mjs tcp://127.0.0.1:5572 [PREFIX] [COUNT]
//
// PREFIX chooses topics: estimate/ (all, the default), estimate/mall/F1/, device/mall/phone-17/ … What was missed, a
// silent engine and one that restarted are told on stderr. Ends after COUNT estimates, if told.

import { decode } from "./messagepack.mjs";
import { Connection } from "./zmtp.mjs";

const [address, prefix = "estimate/", count = "Infinity"] = process.argv.slice(2);
if (!address) {
  console.error("usage: node listener.mjs ADDRESS [PREFIX] [COUNT]");
  process.exit(2);
}
const RECONNECT_MS = 200, SILENCE_MS = 5000;
// Numbers run across floors: who hears one floor only cannot tell a gap from a walk upstairs.
const hearsAllFloors = prefix.startsWith("device/") || /^[^/]*(\/([^/]*\/?)?)?$/.test(prefix);
const lastNumbers = new Map();
let connection, silence, run, heard = 0, done = false;

function connect() {
  connection = new Connection(address, "SUB");
  connection.on("ready", () => {
    connection.subscribe(prefix);
    connection.subscribe("heartbeat");
  });
  connection.on("message", take);
  connection.on("close", (reason) => {
    if (done) return;
    console.error(`no connection to ${address}: ${reason}`);
    setTimeout(connect, RECONNECT_MS);
  });
}

function take([topic, envelope, body]) {
  clearTimeout(silence);
  silence = setTimeout(() => console.error(`nothing heard for ${SILENCE_MS / 1000} s, no heartbeat either`), SILENCE_MS);
  const { run: theirs, seq } = decode(envelope);
  if (theirs !== run) {
    if (run !== undefined) console.error(`the engine restarted: run ${theirs}`);
    run = theirs;
    lastNumbers.clear();
  }
  if (topic.toString() === "heartbeat" || !isNew(topic.toString().split("/"), seq)) return;
  const estimate = decode(body);
  console.log(JSON.stringify(estimate, (_, value) => (typeof value === "bigint" ? value.toString() : value)));
  heard += 1;
  if (heard >= Number(count)) {
    done = true;
    clearTimeout(silence);
    connection.close();
  }
}

function isNew(names, seq) {
  const stream = [names[0], names[1], ...names.slice(-2)].join("/");
  const last = lastNumbers.get(stream);
  lastNumbers.set(stream, seq);
  // The same number again is the last value, sent again because a listener subscribed.
  if (last === seq) return false;
  if (last !== undefined && seq > last + 1 && hearsAllFloors) {
    console.error(`missed ${seq - last - 1} of ${stream}`);
  }
  return true;
}

connect();
