import assert from "node:assert/strict";
import { test } from "node:test";
import { gzipSync } from "node:zlib";

import { PacketCache } from "../src/packet_cache";
import { stepsThatFit } from "../src/step_loader";
import { bytesOfBase64, gunzip, Unreachable, type Source } from "../src/source";

/** A source of packets of a size; counts what it was asked for. */
function sourceOf(bytes: number, bad: string[] = []): Source & { asked: string[] } {
  const asked: string[] = [];
  return {
    saved: false,
    asked,
    packet: (name) => {
      asked.push(name);
      if (bad.includes(name)) return Promise.reject(new Error(`no ${name}`));
      const packet = Buffer.alloc(bytes, " ");
      packet.write("UTWP", 0, "ascii");
      packet.writeUInt32LE(bytes - 8, 4);
      packet.write("{}", 8, "ascii");
      return Promise.resolve(new Uint8Array(packet).buffer as ArrayBuffer);
    },
  };
}

test("memory stays bounded: the least recently used goes first", async () => {
  const source = sourceOf(100);
  const cache = new PacketCache(source, 350);
  for (const name of ["a", "b", "c"]) await cache.get(name);
  cache.peek("a");
  await cache.get("d");
  assert.deepEqual(
    ["a", "b", "c", "d"].map((name) => cache.has(name)),
    [true, false, true, true],
  );
  assert.equal(cache.size, 300);
  for (let k = 0; k < 50; k++) await cache.get(`n${k}`);
  assert.ok(cache.size <= 350);
});

test("frames that are loaded ahead never push each other out", async () => {
  for (const bytes of [100, 1_000, 40_000, 90_000, 500_000]) {
    const cache = new PacketCache(sourceOf(bytes), 100_000);
    const ahead = Math.min(12, stepsThatFit(bytes, cache.limit));
    for (let k = 0; k <= ahead; k++) await cache.get(`points/0/${k}`);
    assert.ok(cache.has("points/0/1") || ahead === 1, `${bytes}`);
  }
});

test("a packet on its way is not asked for twice, one larger than the limit is kept alone", async () => {
  const source = sourceOf(1000);
  const cache = new PacketCache(source, 350);
  await Promise.all([cache.get("a"), cache.get("a"), cache.get("a")]);
  assert.deepEqual(source.asked, ["a"]);
  assert.ok(cache.has("a"));
});

test("a failure is remembered: a damaged packet is not asked for again and again", async () => {
  const source = sourceOf(100, ["x"]);
  const cache = new PacketCache(source);
  await assert.rejects(cache.get("x"), /no x/);
  await assert.rejects(cache.get("x"), /no x/);
  assert.deepEqual(source.asked, ["x"]);
  assert.match(cache.failure("x")!.message, /no x/);
});

test("a server that did not answer is asked again after a while", async (t) => {
  t.mock.timers.enable({ apis: ["setTimeout"] });
  let up = false;
  const sound = sourceOf(100);
  const cache = new PacketCache({
    saved: false,
    packet: (name) => (up ? sound.packet(name) : Promise.reject(new Unreachable("down"))),
  });
  await assert.rejects(cache.get("x"), /down/);
  up = true;
  await assert.rejects(cache.get("x"), /down/);
  t.mock.timers.tick(5000);
  await cache.get("x");
  assert.ok(cache.has("x"));
});

test("a saved page's packets: base64 of gzip, as zlib writes it", async () => {
  const bytes = Buffer.from(Array.from({ length: 70_000 }, (_, k) => (k * k) & 255));
  const back = await gunzip(bytesOfBase64(gzipSync(bytes).toString("base64")));
  assert.ok(Buffer.from(back).equals(bytes));
});
