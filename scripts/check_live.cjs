// The live view with Foxglove's own client (npm: @foxglove/ws-protocol): node scripts/check_live.cjs KLASKTRON FILE
// Replays FILE, subscribes to every channel, and demands that every topic of the recording and its scene come.
"use strict";
const { spawn } = require("node:child_process");
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { WebSocket } = require("ws");

const [klasktron, file] = process.argv.slice(2);
const child = spawn(klasktron, ["replay", file, "--rate", "20", "--live", "foxglove:0"]);
const fail = (text) => {
  console.error(`failed: ${text}`);
  child.kill();
  process.exit(1);
};
setTimeout(() => fail("nothing happened within 120 s"), 120_000).unref();

let stderr = "";
child.stderr.on("data", (text) => {
  const known = /ws:\/\/\S+/.test(stderr);
  stderr += text;
  const found = /ws:\/\/\S+(?= )/.exec(stderr);
  if (found && !known) {
    watch(found[0]);
  }
});

function watch(address) {
  const client = new FoxgloveClient({ ws: new WebSocket(address, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
  const topics = new Map();
  const counts = new Map();
  client.on("error", (error) => fail(error.message));
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      topics.set(client.subscribe(channel.id), channel.topic);
    }
  });
  client.on("message", ({ subscriptionId, data }) => {
    const topic = topics.get(subscriptionId);
    counts.set(topic, (counts.get(topic) ?? 0) + 1);
    if (data.byteLength === 0) {
      fail(`an empty message on ${topic}`);
    }
  });
  client.on("close", () => {
    const silent = [...topics.values()].filter((topic) => !counts.has(topic));
    if (silent.length > 0 || !counts.has("/scene")) {
      fail(`nothing came on ${silent}`);
    }
    const total = [...counts.values()].reduce((sum, own) => sum + own, 0);
    console.log(`Foxglove's client: ${total} messages on ${counts.size} topics`);
    process.exit(0);
  });
}
