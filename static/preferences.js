// What the user chose, kept in the browser where that is allowed.

const KEY = "mary.preferences";

/** The stored preferences over `defaults`. */
export function loadPreferences(defaults) {
  try {
    return { ...defaults, ...JSON.parse(localStorage.getItem(KEY)) };
  } catch {
    return { ...defaults };
  }
}

export function savePreferences(preferences) {
  try {
    localStorage.setItem(KEY, JSON.stringify(preferences));
  } catch {
    // Private windows may refuse; the choice then lasts as long as the page.
  }
}
