// What a page keeps for when it is loaded again: in this tab alone, and for this run of the server alone.

const KEY = `relight-app ${location.pathname}`;

export function keepForReload(value) {
  try {
    sessionStorage.setItem(KEY, JSON.stringify(value));
  } catch {
    // The browser keeps nothing for this page, or not that much.
  }
}

/** What was kept, or null. */
export function keptForReload() {
  try {
    return JSON.parse(sessionStorage.getItem(KEY));
  } catch {
    return null;
  }
}
