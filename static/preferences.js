// What the user chose, kept in the browser where that is allowed.

const KEY = "mary.preferences";

/**
 * The stored preferences over `defaults`. What is stored may be an older page's or anybody's making: a value is taken
 * only if it is of the default's type and, where `accepts` has a function of its name, if that says yes.
 */
export function loadPreferences(defaults, accepts = {}) {
  const stored = read();
  const usable = ([name, value]) => typeof stored[name] === typeof value && (accepts[name]?.(stored[name]) ?? true);
  const kept = Object.entries(defaults).filter(usable);
  return { ...defaults, ...Object.fromEntries(kept.map(([name]) => [name, stored[name]])) };
}

function read() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
}

export function savePreferences(preferences) {
  try {
    localStorage.setItem(KEY, JSON.stringify(preferences));
  } catch {
    // Private windows may refuse; the choice then lasts as long as the page.
  }
}
