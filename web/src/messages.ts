// Sentences that the page has to say: what went wrong, what was done.

import { el, iconButton } from "./dom";

const STAYS_MS = 8000;

export class Messages {
  readonly element = el("div", { className: "messages", role: "status", "aria-live": "polite" });

  say(sentence: string, bad = false): void {
    const same = [...this.element.children].find((one) => one.firstChild?.textContent === sentence);
    same?.remove();
    const message = el(
      "div",
      { className: bad ? "message bad" : "message" },
      el("span", {}, sentence),
      iconButton("close", "Close this message", () => message.remove()),
    );
    this.element.append(message);
    while (this.element.children.length > 3) this.element.firstElementChild?.remove();
    window.setTimeout(() => message.remove(), bad ? 2 * STAYS_MS : STAYS_MS);
  }
}

/** What is said in the middle of the picture when there is nothing to see in it. */
export function emptyState(title: string, ...sentences: string[]): HTMLElement {
  return el(
    "div",
    { className: "empty-state", role: "note" },
    el("h1", {}, title),
    ...sentences.map((sentence) => el("p", {}, sentence)),
  );
}
