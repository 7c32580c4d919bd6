// Packets that were asked for, the least recently used dropped when they are too many bytes.

import { parsePacket, type Packet } from "./packet";
import { Unreachable, type Source } from "./source";

const MEGABYTE = 2 ** 20;
const ASK_AGAIN_MS = 2000;

export class PacketCache {
  private readonly kept = new Map<string, Packet>();
  private readonly coming = new Map<string, Promise<Packet>>();
  private readonly failed = new Map<string, Error>();
  private bytes = 0;

  constructor(
    private readonly source: Source,
    readonly limit = 256 * MEGABYTE,
  ) {}

  /** Returns a packet that is here, and marks it as used. */
  peek(name: string): Packet | undefined {
    const packet = this.kept.get(name);
    if (packet !== undefined) {
      this.kept.delete(name);
      this.kept.set(name, packet);
    }
    return packet;
  }

  has(name: string): boolean {
    return this.kept.has(name);
  }

  /** The size of a packet that is here. */
  bytesOf(name: string): number | undefined {
    return this.kept.get(name)?.bytes;
  }

  failure(name: string): Error | undefined {
    return this.failed.get(name);
  }

  get(name: string): Promise<Packet> {
    const here = this.peek(name);
    if (here !== undefined) return Promise.resolve(here);
    const before = this.failed.get(name);
    if (before !== undefined) return Promise.reject(before);
    let promise = this.coming.get(name);
    if (promise === undefined) {
      promise = this.source
        .packet(name)
        .then((bytes) => {
          const packet = parsePacket(name, bytes);
          this.keep(name, packet);
          return packet;
        })
        .catch((error: Error) => {
          this.failed.set(name, error);
          if (error instanceof Unreachable) {
            setTimeout(() => this.failed.delete(name), ASK_AGAIN_MS);
          }
          throw error;
        })
        .finally(() => this.coming.delete(name));
      this.coming.set(name, promise);
    }
    return promise;
  }

  private keep(name: string, packet: Packet): void {
    this.kept.set(name, packet);
    this.bytes += packet.bytes;
    for (const [oldest, dropped] of this.kept) {
      if (this.bytes <= this.limit || oldest === name) break;
      this.kept.delete(oldest);
      this.bytes -= dropped.bytes;
    }
  }

  get pending(): number {
    return this.coming.size;
  }

  get size(): number {
    return this.bytes;
  }
}
