// Reads recordings with Foxglove's own packages, indexed as its player does, and decodes every message:
//   node check_viewers.cjs FILE...
'use strict';
const assert = require('node:assert');
const { open } = require('node:fs/promises');
const { McapIndexedReader } = require('@mcap/core');
const { FileHandleReadable } = require('@mcap/nodejs');
const { loadDecompressHandlers, protobufFromBinaryDescriptor } = require('@mcap/support');

// Parts of messages, such as the ball of a frame, are objects of their own.
function numbersIn(value) {
  return Object.values(value).reduce((sum, field) => {
    const inside = typeof field === 'object' && field !== null ? numbersIn(field) : 0;
    return sum + (typeof field === 'number' ? 1 : inside);
  }, 0);
}

async function read(path) {
  const file = await open(path, 'r');
  const reader = await McapIndexedReader.Initialize({
    readable: new FileHandleReadable(file),
    decompressHandlers: await loadDecompressHandlers(),
  });
  const types = new Map();
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    assert.strictEqual(channel.messageEncoding, 'protobuf', channel.topic);
    assert.strictEqual(schema.encoding, 'protobuf', channel.topic);
    types.set(channel.id, protobufFromBinaryDescriptor(schema.data).lookupType(schema.name));
  }
  let messages = 0;
  let numbers = 0;
  for await (const message of reader.readMessages()) {
    const value = types.get(message.channelId).toObject(types.get(message.channelId).decode(message.data));
    numbers += numbersIn(value);
    messages += 1;
  }
  assert.strictEqual(BigInt(messages), reader.statistics.messageCount, path);
  assert.ok(0 < numbers, path);
  console.log(`${path}: ${messages} messages on ${types.size} topics, ${numbers} numbers`);
  await file.close();
}

async function main() {
  for (const path of process.argv.slice(2)) {
    await read(path);
  }
}

main().catch((error) => { console.error(error); process.exit(1); });
