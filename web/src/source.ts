// Where packets come from: the server that gave the page, or the page itself when it was saved.

export interface Source {
  saved: boolean;
  packet(name: string): Promise<ArrayBuffer>;
}

/** Returns the inline source when the page carries packets, else the server's. */
export function openSource(page: Document): Source {
  const inline = new Map<string, HTMLScriptElement>();
  for (const tag of page.querySelectorAll<HTMLScriptElement>("script[data-packet]")) {
    inline.set(tag.dataset["packet"] ?? "", tag);
  }
  if (inline.size > 0 || page.location.protocol === "file:") return new SavedPage(inline);
  return new Server();
}

/** The server did not answer at all: asking again later may help. */
export class Unreachable extends Error {}

class Server implements Source {
  readonly saved = false;

  async packet(name: string): Promise<ArrayBuffer> {
    const path = name.split("/").map(encodeURIComponent).join("/");
    let answer: Response;
    try {
      answer = await fetch(`packet/${path}`, { credentials: "omit" });
    } catch {
      throw new Unreachable("The server does not answer: is “urbantwin view” still running?");
    }
    if (!answer.ok) {
      const said = (await answer.text().catch(() => "")).trim().slice(0, 300);
      const plain = answer.headers.get("content-type")?.startsWith("text/plain") ?? false;
      throw new Error(
        plain && said ? said : `The server has no packet “${name}” (${answer.status}).`,
      );
    }
    return answer.arrayBuffer();
  }
}

class SavedPage implements Source {
  readonly saved = true;

  constructor(private readonly tags: Map<string, HTMLScriptElement>) {}

  async packet(name: string): Promise<ArrayBuffer> {
    const tag = this.tags.get(name);
    if (tag === undefined) throw new Error(`This saved page does not hold “${name}”.`);
    try {
      return await gunzip(bytesOfBase64((tag.textContent ?? "").trim()));
    } catch {
      throw new Error(`“${name}” in this saved page is damaged.`);
    }
  }
}

/** Returns the bytes of a base64 text. */
export function bytesOfBase64(text: string): Uint8Array<ArrayBuffer> {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) bytes[k] = letters.charCodeAt(k);
  return bytes;
}

/** Returns what a gzip stream holds. */
export async function gunzip(bytes: Uint8Array<ArrayBuffer>): Promise<ArrayBuffer> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}
