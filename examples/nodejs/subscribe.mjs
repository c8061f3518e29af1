// Subscribes to a topic of tactile_nodes from Node.js, by docs/bus.md ("On the wire") alone. One line of JSON a message.
//
//   npm install
//   node subscribe.mjs /force_distribution [number of messages]
import { existsSync, readdirSync, readFileSync, watch } from "node:fs";
import os from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

import { parse } from "@foxglove/rosmsg";
import { ros2jazzy } from "@foxglove/rosmsg-msgs-common";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { Subscriber } from "zeromq";

const HEADER_BYTES = 44;
const PACKAGE = "tactile_nodes";
const MESSAGES = path.join(path.dirname(fileURLToPath(import.meta.url)), "../../msg");

function runFolder() {
  const { TACTILE_RUN_DIR, XDG_RUNTIME_DIR, ROS_DOMAIN_ID } = process.env;
  const { uid } = os.userInfo();
  const login = [XDG_RUNTIME_DIR, `/run/user/${uid}`].find((folder) => folder && existsSync(folder));
  const base = TACTILE_RUN_DIR || (login ? path.join(login, "tactile") : path.join(os.tmpdir(), `tactile-${uid}`));
  return path.join(base, `d${ROS_DOMAIN_ID || 0}`);
}

// Every publisher of a topic has an outlet: {gid, topic, type_name, address, latched}.
function outletsOf(topic, folder) {
  const records = readdirSync(folder).filter((name) => /^[0-9a-f]{8}\.json$/.test(name));
  return records
    .flatMap((name) => outletsIn(path.join(folder, name)))
    .filter((outlet) => outlet.topic === topic);
}

// None if the process has ended since the folder was read: its record is gone.
function outletsIn(file) {
  try {
    return JSON.parse(readFileSync(file, "utf8")).outlets;
  } catch (error) {
    if (error.code === "ENOENT") return [];
    throw error;
  }
}

// The fields of a type: of this package's from its .msg file, of ROS 2's from the library.
function definitionOf(name) {
  const [pkg, kind] = name.split("/");
  if (pkg !== PACKAGE) return ros2jazzy[name];
  const text = readFileSync(path.join(MESSAGES, `${kind}.msg`), "utf8");
  const [{ definitions }] = parse(text, { ros2: true, skipTypeFixup: true });
  return { name, definitions: definitions.map(completed) };
}

// Contact means tactile_nodes/Contact.
function completed(field) {
  if (!field.isComplex || field.type.includes("/")) return field;
  return { ...field, type: `${PACKAGE}/${field.type}` };
}

function readerOf(typeName) {
  const found = new Map();
  const add = (name) => {
    if (found.has(name)) return;
    found.set(name, definitionOf(name));
    found.get(name).definitions.filter((field) => field.isComplex).forEach((field) => add(field.type));
  };
  add(typeName.replace("/msg/", "/"));
  return new MessageReader([...found.values()]);
}

async function listen(outlet, count) {
  const reader = readerOf(outlet.type_name);
  const socket = new Subscriber();
  socket.connect(outlet.address);
  socket.subscribe("");
  let lastNumber = 0n;
  for await (const frames of socket) {
    const whole = Buffer.concat(frames);
    if (whole.length < HEADER_BYTES || whole.toString("latin1", 0, 4) !== "TNM1") continue;
    const number = whole.readBigUInt64LE(28);
    if (number <= lastNumber) continue; // a latched message that was sent once more
    const lost = lastNumber ? number - lastNumber - 1n : 0n;
    lastNumber = number;
    const message = reader.readMessage(whole.subarray(HEADER_BYTES));
    const meta = { number: Number(number), lost: Number(lost), published_ns: String(whole.readBigInt64LE(36)) };
    const last = --count.left <= 0;
    process.stdout.write(`${JSON.stringify({ ...meta, message }, plain)}\n`, () => last && process.exit(0));
    if (last) return;
  }
}

function plain(_key, value) {
  if (typeof value === "bigint") return String(value);
  if (ArrayBuffer.isView(value)) return Array.from(value);
  return Number.isNaN(value) ? null : value;
}

const [asked = "force_distribution", wanted = "Infinity"] = process.argv.slice(2);
const topic = asked.startsWith("/") ? asked : `/${asked}`;
const [folder, count, heard] = [runFolder(), { left: Number(wanted) }, new Set()];

function look() {
  for (const outlet of outletsOf(topic, folder)) {
    if (heard.has(outlet.address)) continue;
    heard.add(outlet.address);
    listen(outlet, count);
  }
}

if (!existsSync(folder)) {
  console.error(`nothing runs: there is no ${folder}; start tactile launch live, or set ROS_DOMAIN_ID as it has it`);
  process.exit(1);
}
watch(folder, look); // a record is replaced as a whole whenever somebody comes or says something new
look();
