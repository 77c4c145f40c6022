// Prints each ROS 2 message of an MCAP file as a line of JSON: topic, log time, and the message as Foxglove's packages decode it.
// node plots.js FILE
import { open } from "node:fs/promises";

import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";

const file = await open(process.argv[2], "r");
const { size } = await file.stat();
const readable = {
  size: async () => BigInt(size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await file.read(buffer, 0, buffer.length, Number(offset));
    return buffer;
  },
};
const decompressHandlers = { zstd: (packed, unpacked) => decompress(packed, new Uint8Array(Number(unpacked))) };
const recording = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const readers = new Map();
for (const [id, channel] of recording.channelsById) {
  const schema = recording.schemasById.get(channel.schemaId);
  if (schema.encoding === "ros2msg" && channel.messageEncoding === "cdr") {
    const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
    readers.set(id, { topic: channel.topic, reader: new MessageReader(definition) });
  }
}
const numbers = (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
for await (const { channelId, logTime, data } of recording.readMessages()) {
  const channel = readers.get(channelId);
  if (channel) {
    const message = channel.reader.readMessage(data);
    console.log(JSON.stringify({ topic: channel.topic, logTime: String(logTime), message }, numbers));
  }
}
