// The view in the page's address: a link to it restores it.

import type { App } from "./app";
import { hashOf, viewOfHash } from "./view_state";

const WAIT_MS = 400;

/** The address with the whole view in its hash. */
export function linkOf(app: App): string {
  app.remember();
  const hash = hashOf(app.view, app.base);
  return location.href.replace(/#.*$/, "") + (hash ? `#${hash}` : "");
}

/** Keeps the address as the view is, and the view as an address that somebody opens says. */
export function keepAddress(app: App): void {
  let timer = 0;
  app.onView = () => {
    window.clearTimeout(timer);
    timer = window.setTimeout(() => {
      // Not while it plays: browsers allow only so many changes of the address.
      if (app.clock.playing || !app.placed) return;
      try {
        history.replaceState(null, "", linkOf(app));
      } catch {
        // An address that may not be changed (a page inside another) keeps what it has.
      }
    }, WAIT_MS);
  };
  window.addEventListener("hashchange", () => {
    const view = viewOfHash(location.hash, app.base);
    if (hashOf(view, app.base) !== hashOf(app.view, app.base)) app.restore(view);
  });
}
