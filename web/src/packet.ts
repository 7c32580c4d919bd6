// A packet: a header in JSON and arrays, each at a multiple of eight bytes.

export type PacketArray = Float32Array | Uint8Array | Uint16Array | Uint32Array | Int32Array;

export interface Packet {
  header: Record<string, unknown>;
  arrays: Map<string, { data: PacketArray; shape: number[] }>;
  bytes: number;
}

const MAGIC = "UTWP";
const TYPES: Record<string, [number, (b: ArrayBuffer, at: number, n: number) => PacketArray]> = {
  f4: [4, (b, at, n) => new Float32Array(b, at, n)],
  u1: [1, (b, at, n) => new Uint8Array(b, at, n)],
  u2: [2, (b, at, n) => new Uint16Array(b, at, n)],
  u4: [4, (b, at, n) => new Uint32Array(b, at, n)],
  i4: [4, (b, at, n) => new Int32Array(b, at, n)],
};

/** Returns a packet whose arrays are views into the bytes; throws an Error that says what is wrong. */
export function parsePacket(name: string, bytes: ArrayBuffer): Packet {
  const wrong = (what: string): Error => new Error(`Packet “${name}” is damaged: ${what}.`);
  if (bytes.byteLength < 8) throw wrong(`${bytes.byteLength} bytes, at least 8 were expected`);
  const view = new DataView(bytes);
  const magic = String.fromCharCode(...new Uint8Array(bytes, 0, 4));
  if (magic !== MAGIC) throw wrong("it does not begin with UTWP");
  const length = view.getUint32(4, true);
  if (8 + length > bytes.byteLength) throw wrong("its header is longer than the packet");
  let header: Record<string, unknown>;
  try {
    header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, length)));
  } catch {
    throw wrong("its header is not JSON");
  }
  if (typeof header !== "object" || header === null) throw wrong("its header is not an object");
  const listed = Array.isArray(header["arrays"]) ? header["arrays"] : [];
  const begin = 8 + length;
  const arrays: Packet["arrays"] = new Map();
  for (const entry of listed as { name: string; type: string; shape: number[]; offset: number }[]) {
    const type = TYPES[entry.type];
    if (type === undefined) throw wrong(`array “${entry.name}” has the unknown type ${entry.type}`);
    const [size, make] = type;
    const count = entry.shape.reduce((product, n) => product * n, 1);
    const at = begin + entry.offset;
    if (!(count >= 0) || !(entry.offset >= 0) || at + count * size > bytes.byteLength) {
      throw wrong(`array “${entry.name}” reaches beyond its end`);
    }
    if (at % size !== 0) throw wrong(`array “${entry.name}” begins at an odd place`);
    arrays.set(entry.name, { data: make(bytes, at, count), shape: entry.shape });
  }
  return { header, arrays, bytes: bytes.byteLength };
}
