import assert from "node:assert/strict";
import { test } from "node:test";

import { PointFrame } from "../src/frame_data";
import { parsePacket } from "../src/packet";

// Written byte by byte from the format's description, not by any code of the page.
function packetOf(header: object, body: Uint8Array): ArrayBuffer {
  let text = JSON.stringify(header);
  while ((8 + Buffer.byteLength(text)) % 8 !== 0) text += " ";
  const head = Buffer.from(text, "utf8");
  const start = Buffer.alloc(8);
  start.write("UTWP", "ascii");
  start.writeUInt32LE(head.length, 4);
  return new Uint8Array(Buffer.concat([start, head, body])).buffer as ArrayBuffer;
}

test("arrays are read where the header says, little endian", () => {
  const body = Buffer.alloc(24);
  body.writeUInt16LE(1, 0);
  body.writeUInt16LE(2, 2);
  body.writeUInt16LE(65535, 4);
  body.writeFloatLE(1.5, 8);
  body.writeFloatLE(-2.25, 12);
  body.writeInt32LE(-7, 16);
  const header = {
    arrays: [
      { name: "position", type: "u2", shape: [1, 3], offset: 0 },
      { name: "time", type: "f4", shape: [2], offset: 8 },
      { name: "n", type: "i4", shape: [1], offset: 16 },
    ],
    word: "Straße",
  };
  const packet = parsePacket("points/0/0", packetOf(header, body));
  assert.deepEqual([...packet.arrays.get("position")!.data], [1, 2, 65535]);
  assert.deepEqual([...packet.arrays.get("time")!.data], [1.5, -2.25]);
  assert.deepEqual([...packet.arrays.get("n")!.data], [-7]);
  assert.equal(packet.header["word"], "Straße");
});

test("positions are origin plus steps, and a smaller frame after a larger one forgets its fields", () => {
  const body = Buffer.alloc(24);
  [10, 20, 30, 0, 0, 65535].forEach((v, k) => body.writeUInt16LE(v, 2 * k));
  body.writeUInt8(200, 16);
  body.writeUInt8(3, 17);
  const frame = new PointFrame();
  const arrays = [
    { name: "position", type: "u2", shape: [2, 3], offset: 0 },
    { name: "intensity", type: "u1", shape: [2], offset: 16 },
  ];
  frame.load(parsePacket("a", packetOf({ arrays, origin: [-5, 0.5, 100], step: 0.01 }, body)));
  assert.equal(frame.count, 2);
  const expected = [-4.9, 0.7, 100.3, -5, 0.5, 755.35];
  expected.forEach((v, k) => assert.ok(Math.abs(frame.position[k]! - v) < 1e-4, `${k}`));
  assert.deepEqual([...frame.fields.get("intensity")!], [200, 3]);
  const buffer = frame.position;
  const one = [{ name: "position", type: "f4", shape: [1, 3], offset: 0 }];
  const floats = Buffer.alloc(16);
  [1, 2, 3].forEach((v, k) => floats.writeFloatLE(v, 4 * k));
  frame.load(parsePacket("b", packetOf({ arrays: one }, floats)));
  assert.equal(frame.position, buffer, "no new array for a smaller frame");
  assert.deepEqual([...frame.position.subarray(0, 3)], [1, 2, 3]);
  assert.equal(frame.fields.size, 0);
});

test("damage is told in a sentence that names the packet", () => {
  const sound = packetOf(
    { arrays: [{ name: "p", type: "f4", shape: [2], offset: 0 }] },
    Buffer.alloc(8),
  );
  const bad: [ArrayBuffer, RegExp][] = [
    [sound.slice(0, 3), /3 bytes/],
    [new TextEncoder().encode("<html>not one</html>").buffer as ArrayBuffer, /begin with UTWP/],
    [sound.slice(0, 20), /longer than the packet/],
    [sound.slice(0, sound.byteLength - 4), /reaches beyond/],
    [
      packetOf({ arrays: [{ name: "p", type: "f8", shape: [1], offset: 0 }] }, Buffer.alloc(8)),
      /unknown type f8/,
    ],
    [
      packetOf({ arrays: [{ name: "p", type: "f4", shape: [1], offset: 2 }] }, Buffer.alloc(8)),
      /odd place/,
    ],
    [
      packetOf({ arrays: [{ name: "p", type: "f4", shape: [-3], offset: 0 }] }, Buffer.alloc(8)),
      /reaches beyond/,
    ],
  ];
  for (const [bytes, message] of bad) {
    assert.throws(
      () => parsePacket("points/0/3", bytes),
      (error: Error) => {
        assert.match(error.message, /points\/0\/3/);
        assert.match(error.message, message);
        return true;
      },
    );
  }
});
